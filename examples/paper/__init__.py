"""The figures and tables of the source, computed and drawn again."""
