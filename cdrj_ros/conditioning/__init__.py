"""Conversion of readings to samples."""
