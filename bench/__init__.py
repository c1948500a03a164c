"""Speed of the estimator relative to comparable software: ``python -m bench``, docs/speed.md."""
