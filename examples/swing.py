"""Wish motor angles that swing a robot's first joint, 200 times a second, with its preloads kept.

    python3 swing.py --ros-args -p robot:=finger

They are published on /cdrj/wished/position, from which a controller such as keep_taut makes the
commands of the motors.  After the first /cdrj/tensions it waits until all nodes know each
other, so that motors and controller follow the motion from its start.
"""

import numpy as np
import rclpy
from cdrj_msgs.msg import CableTensions
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

import cdrj_ros as cdrj

RATE_HZ, PERIOD_S, START_S, WAIT_S = 200.0, 5.0, 1.0, 3.0
MIDDLE, AMPLITUDE = 0.5, 0.35  # of the joint's angle [rad]


class SwingNode(Node):
    """Publishes the motor angles of a slow start, then of a swing that repeats."""

    def __init__(self):
        super().__init__("swing", namespace="cdrj")
        model = cdrj.load(self.declare_parameter("robot", "finger").value)
        time_s = np.arange(round((START_S + PERIOD_S) * RATE_HZ)) / RATE_HZ
        pose = np.tile(model.robot.reference_pose, (time_s.size, 1))
        swing = np.sin(2.0 * np.pi * np.maximum(time_s - START_S, 0.0) / PERIOD_S)
        pose[:, 0] += MIDDLE * np.minimum(time_s / START_S, 1.0) + AMPLITUDE * swing
        self.angles = cdrj.follow_joints(model, pose).motor_angle
        self.sent, self.start = -round(WAIT_S * RATE_HZ), round(START_S * RATE_HZ)
        self.publisher = self.create_publisher(Float64MultiArray, "wished/position", 1)
        self.waiting = self.create_subscription(CableTensions, "tensions", self.on_tensions, 1)

    def on_tensions(self, _):
        """Begin the motion."""
        if self.waiting is not None:
            self.destroy_subscription(self.waiting)
            self.waiting = None
            self.create_timer(1.0 / RATE_HZ, self.on_timer)

    def on_timer(self):
        """Publish the next angles."""
        k = max(self.sent, 0)
        if k >= self.start:
            k = self.start + (k - self.start) % (len(self.angles) - self.start)
        self.publisher.publish(Float64MultiArray(data=self.angles[k].tolist()))
        self.sent += 1


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(SwingNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        if rclpy.ok():  # otherwise Ctrl-C came while a message was being published
            raise


if __name__ == "__main__":
    main()
