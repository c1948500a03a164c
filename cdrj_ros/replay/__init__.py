"""Playback of a bag, without ROS."""
