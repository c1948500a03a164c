"""Command lines: arguments, printing, exit codes."""
