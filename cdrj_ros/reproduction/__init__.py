"""The figures and tables of the source, redrawn."""
