"""Readings become samples."""
