"""Estimates beside recorded references."""
