"""Read the tensions in a controller and reject those that must not be used.

python3 read_tensions.py    # with a running estimator; --ros-args -r tensions:=/other/topic
"""

from contextlib import suppress

import rclpy
from cdrj_msgs.msg import CableTensions
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

REFUSED = CableTensions.STALE | CableTensions.INVALID | CableTensions.UNSURE
SILENCE_S = 0.5  # a stopped estimator publishes no STALE status, so silence is detected here


class TensionReader(Node):
    """Logs the largest tension plus 2 sigma, or the reason for rejecting a message."""

    def __init__(self):
        super().__init__("read_tensions", namespace="cdrj")
        self.create_subscription(CableTensions, "tensions", self.on_tensions, 1)
        self.watchdog = self.create_timer(SILENCE_S, self.on_silence)

    def on_tensions(self, message):
        """Use a message if every element is usable and has a standard deviation."""
        self.watchdog.reset()
        refused = [n for n, s in zip(message.name, message.status, strict=True) if s & REFUSED]
        if refused or len(message.stddev) != len(message.name) or not message.name:
            text = f"refused: {', '.join(refused) or 'no standard deviations'}"
            self.get_logger().warning(text, throttle_duration_sec=1.0)
            return
        worst = [t + 2.0 * s for t, s in zip(message.tension, message.stddev, strict=True)]
        largest = max(worst)  # upper bound of the tension with 97.7 % probability per element
        text = f"{message.name[worst.index(largest)]}: {largest:.2f} N"
        self.get_logger().info(text, throttle_duration_sec=1.0)

    def on_silence(self):
        """React to missing messages: the tensions are unknown."""
        self.get_logger().warning(f"refused: nothing for {SILENCE_S} s", throttle_duration_sec=1.0)


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(TensionReader())


if __name__ == "__main__":
    main()
