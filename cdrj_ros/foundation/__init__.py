"""Utilities shared by all packages: errors, writing of files, output and progress, YAML."""
