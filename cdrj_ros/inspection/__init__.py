"""Lengths, losses and tensions that follow from a robot file, and values that look wrong."""
