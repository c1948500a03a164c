"""The ROS nodes: convert, step, publish. The only place that imports rclpy and the messages."""
