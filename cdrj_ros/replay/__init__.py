"""Playing a bag, without ROS."""
