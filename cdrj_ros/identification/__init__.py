"""Identification of the robot file's parameters, with standard errors, from recordings."""
