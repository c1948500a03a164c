"""From samples to estimates, and how good the estimates are."""
