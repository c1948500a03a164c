"""Checks of a robot file without samples: values over the joint ranges, and suspicions."""
