"""The description of a robot: reading, checking, writing and importing robot files."""
