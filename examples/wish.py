"""Publish a constant wish to a controller, 50 times a second.

python3 wish.py velocity 0.5           # [rad/s], a number per motor
python3 wish.py position 0.1 0.1 0.1   # [rad]
"""

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Float64MultiArray


class WishNode(Node):
    """Publishes the same numbers on /cdrj/wished/MODE."""

    def __init__(self, mode, values):
        super().__init__("wish", namespace="cdrj")
        message = Float64MultiArray(data=values)
        publisher = self.create_publisher(Float64MultiArray, f"wished/{mode}", 1)
        self.create_timer(0.02, lambda: publisher.publish(message))


def main():
    """Run until Ctrl-C."""
    arguments = remove_ros_args(sys.argv)[1:]
    if len(arguments) < 2 or arguments[0] not in ("velocity", "position"):
        sys.exit(__doc__)
    values = [float(value) for value in arguments[1:]]
    rclpy.init()
    try:
        rclpy.spin(WishNode(arguments[0], values))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        if rclpy.ok():  # otherwise Ctrl-C came while a message was being published
            raise


if __name__ == "__main__":
    main()
