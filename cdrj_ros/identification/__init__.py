"""Recordings become parameters with standard errors."""
