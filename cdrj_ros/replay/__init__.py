"""The parts of the replay that do not depend on ROS."""
