"""The ROS 2 nodes: convert, call, publish. Only this package imports rclpy and the messages."""
