"""Wish motor angles that swing a robot's first joint, 200 times a second, with its preloads kept.

    python3 swing.py --ros-args -p robot:=finger

They are published on /cdrj/wished/position, from which a controller such as keep_taut makes the
commands of the motors.
"""

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

import cdrj_ros as cdrj

RATE_HZ, PERIOD_S, START_S = 200.0, 5.0, 1.0
MIDDLE, AMPLITUDE = 0.5, 0.35  # of the joint's angle [rad]


class SwingNode(Node):
    """Publishes the motor angles of a slow start, then of a swing that repeats."""

    def __init__(self):
        super().__init__("swing", namespace="cdrj")
        model = cdrj.load(self.declare_parameter("robot", "finger").value)
        time_s = np.arange(round((START_S + PERIOD_S) * RATE_HZ)) / RATE_HZ
        pose = np.tile([joint.reference_angle for joint in model.robot.joints], (time_s.size, 1))
        swing = np.sin(2.0 * np.pi * np.maximum(time_s - START_S, 0.0) / PERIOD_S)
        pose[:, 0] += MIDDLE * np.minimum(time_s / START_S, 1.0) + AMPLITUDE * swing
        self.angles = cdrj.follow_joints(model, pose).motor_angle
        self.sent, self.start = 0, round(START_S * RATE_HZ)
        self.publisher = self.create_publisher(Float64MultiArray, "wished/position", 1)
        self.create_timer(1.0 / RATE_HZ, self.on_timer)

    def on_timer(self):
        """Publish the next angles."""
        k = self.sent
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
