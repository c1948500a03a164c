"""Parameters of the robot file, with standard errors, from recordings."""
