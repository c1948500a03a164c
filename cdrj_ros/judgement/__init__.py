"""Comparison of estimates with recorded references."""
