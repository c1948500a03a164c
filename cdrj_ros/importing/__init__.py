"""Conversion of models of other programs to robot files."""
