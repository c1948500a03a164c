"""What a robot file implies before anything moves."""
