"""What every room stands on: errors, writing files, progress on a terminal."""
