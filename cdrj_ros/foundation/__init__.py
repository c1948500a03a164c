"""What every room uses: errors, files, YAML, time series, printing, progress, interruption."""
