"""A virtual tension sensor for cables that run over pulleys, for ROS 2."""

__version__ = "0.1.0"
