"""What every room uses: errors, files, YAML, printing, progress, interruption."""
