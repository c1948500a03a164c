"""The simulated rig: prescribed joint motion, finer truth than the estimator's, real sensors."""
