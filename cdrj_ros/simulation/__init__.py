"""The simulated rig: a model finer than the estimator's, with realistic sensors and faults."""
