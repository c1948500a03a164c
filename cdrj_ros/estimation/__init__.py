"""Estimates with standard deviations from samples."""
