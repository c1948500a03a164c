"""The ROS 2 nodes: convert, call, publish. The only room that imports rclpy and the messages."""
