"""The physics: frozen values and pure functions; knows nothing of time series, files or ROS."""
