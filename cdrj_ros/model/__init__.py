"""One sample of physics: angles and friction history in, tensions out."""
