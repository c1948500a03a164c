"""The command lines: arguments, printing and exit codes, nothing else."""
