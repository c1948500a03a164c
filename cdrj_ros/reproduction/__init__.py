"""The source's figures and tables, from this package: its curves beside those of the rig."""
