"""Code that all rooms use: errors, files, YAML, time series, printing, progress, interruption."""
