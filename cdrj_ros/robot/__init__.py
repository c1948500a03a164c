"""The description of a robot: reading, checking and writing robot files."""
