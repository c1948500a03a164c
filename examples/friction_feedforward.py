"""Compensate the stretch and the friction of the cables in the commanded motor angle.

    python3 friction_feedforward.py --ros-args -p robot:=prototype -p payload:=0.3

Publish targets of the joint as sensor_msgs/JointState on /cdrj/wished/joints, at 100 Hz or more:
position [rad] and, where known, velocity [rad/s] and, in the field effort, acceleration [rad/s^2].
The node publishes motor angles on /cdrj/commands/position.  The angles of the undeformed mechanism
would leave the joint short of its target by the cables' stretch and by friction.
"""

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from scipy.optimize import brentq
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

import cdrj_ros as cdrj

BRACKET, WIDEST = 1e-3, 2.0  # first and largest half width of the search for the angle [rad]
ACCURACY = 1e-7  # of the angle [rad]


class FrictionFeedforward:
    """Inverse model: the motor angle at which the cables hold or move the joint as desired.

    The estimator's own `step` runs along the desired motion and thus includes the history of
    friction at every pulley.  In each step the motor angle is the root of

        effort of the cables on the joint (motor angle, wished joint angle) = torque of the load

    The method is for one motor; several need a rule for sharing the load among them.
    """

    def __init__(self, model, load):
        """Start in the reference pose without friction.

        Args:
            model: the prepared robot, with one motor and one joint.
            load: of the joint, from ``cdrj.make_load``.
        """
        if (len(model.robot.motors), len(model.robot.joints)) != (1, 1):
            raise cdrj.UsageError(f"{model.robot.name} must have one motor and one joint")
        self.model, self.load = model, load
        self.sign = float(model.robot.joints[0].effort_sign)
        self.state = cdrj.initial_state(model)
        self.correction = 0.0

    def rigid(self, target):
        """Motor angle of the undeformed mechanism at a joint angle [rad]."""
        return float(cdrj.follow_joints(self.model, np.array([[target]])).motor_angle[0, 0])

    def angle(self, stamp_ns, target, speed=0.0, acceleration=0.0):
        """Motor angle for the desired motion [rad].

        Args:
            stamp_ns: time of the target, later than in the last call [ns].
            target, speed, acceleration: of the joint [rad], [rad/s], [rad/s^2].
        """
        motion = (np.array([value]) for value in (target, speed, acceleration))
        torque = float(self.load.torque(*motion)[0])
        rigid = self.rigid(target)

        def advanced(correction):
            angles = np.array([rigid + correction]), np.array([target])
            return cdrj.step(self.model, self.state, cdrj.Sample(stamp_ns, *angles))

        def imbalance(correction):
            return self.sign * float(advanced(correction)[1].joint_effort[0]) - torque

        self.correction = _root_near(imbalance, self.correction)
        self.state = advanced(self.correction)[0]
        return rigid + self.correction


def _root_near(function, start):
    """Root of a monotonic function, from a bracket that grows around ``start``."""
    width = BRACKET
    while width < WIDEST:
        low, high = start - width, start + width
        if function(low) * function(high) <= 0.0:
            return brentq(function, low, high, xtol=ACCURACY)
        width *= 4.0
    return start


class FeedforwardNode(Node):
    """Turns targets of the joint into angles of the motor."""

    def __init__(self, **options):
        super().__init__("friction_feedforward", namespace="cdrj", **options)
        model = cdrj.load(self.declare_parameter("robot", "prototype").value)
        payload = self.declare_parameter("payload", 0.3).value
        damping = self.declare_parameter("damping", 0.05).value
        load = cdrj.make_load(cdrj.usual_load(model.robot, 0), payload, damping)
        self.make = lambda: FrictionFeedforward(model, load)
        self.law, self.last_ns = self.make(), 0
        joint = model.robot.joints[0]
        self.lower, self.upper = joint.lower, joint.upper
        self.publisher = self.create_publisher(Float64MultiArray, "commands/position", 1)
        self.create_subscription(JointState, "wished/joints", self.on_target, 10)

    def on_target(self, message):
        """Command the motor angle for one target."""
        parts = (message.position, message.velocity, message.effort)
        target, speed, acceleration = (part[0] if len(part) else 0.0 for part in parts)
        reachable = len(message.position) == 1 and self.lower <= target <= self.upper
        if not reachable or not np.isfinite([speed, acceleration]).all():
            text = f"wished/joints needs one angle in [{self.lower:.3g}, {self.upper:.3g}] rad"
            self.get_logger().error(text, throttle_duration_sec=1.0)
            return
        stamp_ns = self.get_clock().now().nanoseconds
        if stamp_ns <= self.last_ns:  # the clock was set back: discard the friction history
            self.law = self.make()
        self.last_ns = stamp_ns
        angle = self.law.angle(stamp_ns, target, speed, acceleration)
        self.publisher.publish(Float64MultiArray(data=[angle]))


def main():
    """Run until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(FeedforwardNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        if rclpy.ok():  # otherwise Ctrl-C came while a message was being published
            raise


if __name__ == "__main__":
    main()
