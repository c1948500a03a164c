"""Conversion between serialised messages and values."""
