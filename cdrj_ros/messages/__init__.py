"""Serialised messages to values and back."""
