"""Keep the tests' ROS traffic to themselves.

Set before anything imports rclpy, and inherited by every process a test starts: a domain of this
run's own, and no discovery beyond this machine. Two runs side by side do not hear each other.
"""

import os

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
