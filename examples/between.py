"""Base class of the controllers: a node that modifies motor commands before their execution."""

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

import cdrj_ros as cdrj

SILENCE_S = 0.1
"""Time without a new estimate, or without a new command, after which the last is not used [s]."""


class Between(Node):
    """Receives /cdrj/wished/MODE and estimates; publishes /cdrj/commands/MODE for every estimate.

    Both have one number per motor, in the robot file's order: speeds [rad/s] with the mode
    ``velocity``, angles [rad] with ``position``.  A subclass overrides ``changed``.  While the
    parameter ``active`` is false, the wishes are the commands.
    """

    def __init__(self, name, mode, message, topic, **options):
        super().__init__(name, namespace="cdrj", **options)
        self.model = cdrj.load(self.declare_parameter("robot", "prototype").value)
        self.motors = len(self.model.robot.motors)
        self.declare_parameter("active", True)
        self.mode, self.wished, self.wished_ns, self.last_ns = mode, None, 0, 0
        self.publisher = self.create_publisher(Float64MultiArray, f"commands/{mode}", 1)
        self.create_subscription(Float64MultiArray, f"wished/{mode}", self.on_wish, 1)
        self.create_subscription(message, topic, self.on_estimate, 1)
        self.watchdog = self.create_timer(SILENCE_S, self.on_silence)

    def changed(self, wished, dt, message):
        """Commands for all motors, and a warning or "".

        Args:
            wished: the desired commands, one number per motor.
            dt: time since the previous call [s]; 0 for the first estimate, and after a jump of
                the clock.
            message: the estimate; None if none has arrived for ``SILENCE_S``.
        """
        raise NotImplementedError

    def released(self):
        """Called instead of ``changed`` while the controller is switched off."""

    def on_wish(self, message):
        """Store the desired commands if they are one finite number per motor."""
        if len(message.data) != self.motors or not np.isfinite(message.data).all():
            self.wished = None
            self.get_logger().error(f"wished/{self.mode} needs {self.motors} finite numbers")
            return
        self.wished = np.array(message.data)
        self.wished_ns = self.get_clock().now().nanoseconds

    def on_estimate(self, message):
        """Publish the commands that follow from this estimate."""
        self.watchdog.reset()
        stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        dt = (stamp_ns - self.last_ns) * 1e-9 if self.last_ns else 0.0
        self.last_ns = stamp_ns
        self.send(dt if 0.0 < dt < SILENCE_S else 0.0, message)

    def on_silence(self):
        """Publish the commands that are permitted without an estimate."""
        self.last_ns = 0
        self.send(SILENCE_S, None)
        self.get_logger().warning(f"no estimate for {SILENCE_S} s", throttle_duration_sec=1.0)

    def send(self, dt, message):
        """Publish the commands; desired speeds older than ``SILENCE_S`` are replaced by zero."""
        if self.wished is None:
            return
        wished = self.wished
        age_s = (self.get_clock().now().nanoseconds - self.wished_ns) * 1e-9
        if self.mode == "velocity" and not 0.0 <= age_s <= SILENCE_S:
            wished = np.zeros_like(wished)
        if self.get_parameter("active").value:
            command, warning = self.changed(wished, dt, message)
        else:
            command, warning = wished, ""
            self.released()
        if warning:
            self.get_logger().warning(warning, throttle_duration_sec=1.0)
        self.publisher.publish(Float64MultiArray(data=np.asarray(command).tolist()))


def spin(make):
    """Run a node until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(make())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        if rclpy.ok():  # otherwise Ctrl-C came while a message was being published
            raise
