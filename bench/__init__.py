"""Speed of the estimator, as ratios to what else there is: ``python -m bench``, docs/speed.md."""
