"""Estimates with standard deviations from readings, and detection of changes of the robot."""
