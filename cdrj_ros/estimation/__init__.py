"""Samples become estimates with standard deviations."""
