"""Comparison of estimates with recorded references, for one recording or many."""
