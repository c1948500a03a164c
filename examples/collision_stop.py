"""Stop the motors when an external force acts on a joint.

    python3 collision_stop.py --ros-args -p robot:=prototype -p payload:=0.3 -p threshold:=0.5

Publish the wished speeds [rad/s], one per motor in the robot file's order, on /cdrj/wished/velocity
instead of /cdrj/commands/velocity.  The external torque on the first joint is the torque that its
motion requires minus the estimated torque of the cables.  If it exceeds the threshold plus 2 sigma,
the motors stop until ~/release is called.  They also stop if no efforts arrive.
"""

import numpy as np
from between import Between, spin
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

import cdrj_ros as cdrj

BANDWIDTH = 60.0  # of the observer [rad/s]
SPEED_FILTER_S = 0.005  # of the joint's speed from its encoder [s]


class PushObserver:
    """Momentum observer: the external torque on a joint, low-passed with ``BANDWIDTH``.

    With the momentum p = D(q) q' and the load's equation D q'' + D' q'^2 / 2 + c q' + weight =
    torque,

        r = K (p - integral of (cables' torque - weight - c q' + D'(q) q'^2 / 2 + r) dt)

    is the external torque after a first-order low-pass filter; no acceleration is needed (De Luca,
    Mattone: Sensorless robot collision detection and hybrid force/motion control, ICRA 2005).
    """

    def __init__(self, load):
        """Start at rest.

        Args:
            load: of the joint, from ``cdrj.make_load``.
        """
        self.load = load
        self.torque, self.speed = 0.0, 0.0
        self.before, self.integral = None, 0.0

    def update(self, dt, angle, effort):
        """Advance by ``dt`` [s]; returns the external torque [N m].

        Args:
            dt: time since the last call [s].
            angle: of the joint [rad].
            effort: torque of the cables on it, positive along positive angle [N m].
        """
        if self.before is None:
            self.before = angle
            return 0.0
        share = dt / (dt + SPEED_FILTER_S)
        self.speed += share * ((angle - self.before) / dt - self.speed)
        self.before = angle
        weight = self.required(angle)
        momentum = (self.required(angle, acceleration=1.0) - weight) * self.speed
        damping = self.load.damping * self.speed
        pull = effort - weight - damping
        pull += self.required(angle, self.speed) - weight - damping  # D' q'^2 / 2
        self.integral += (pull + self.torque) * dt
        self.torque = BANDWIDTH * (momentum - self.integral)
        return self.torque

    def required(self, angle, speed=0.0, acceleration=0.0):
        """Torque that the load requires of the cables in this motion [N m]."""
        return float(self.load.torque(*np.array([[angle], [speed], [acceleration]]))[0])


class CollisionNode(Between):
    """Forwards the desired speeds until a push is detected."""

    def __init__(self, **options):
        super().__init__("collision_stop", "velocity", JointState, "efforts", **options)
        robot = self.model.robot
        self.joint, self.sign = robot.joints[0].name, robot.joints[0].effort_sign
        payload = self.declare_parameter("payload", 0.3).value
        damping = self.declare_parameter("damping", 0.05).value
        self.threshold = self.declare_parameter("threshold", 0.5).value
        self.observer = PushObserver(cdrj.make_load(cdrj.usual_load(robot, 0), payload, damping))
        self.angle, self.stddev, self.reason = None, 0.0, ""
        self.create_subscription(JointState, "joint_states", self.on_joint, 1)
        self.create_subscription(JointState, "efforts_stddev", self.on_stddev, 1)
        self.create_service(Trigger, "~/release", self.on_release)

    def on_joint(self, message):
        """Keep the joint's angle."""
        if self.joint in message.name[: len(message.position)]:
            self.angle = message.position[message.name.index(self.joint)]

    def on_stddev(self, message):
        """Keep the standard deviation of the cables' torque."""
        if self.joint in message.name[: len(message.effort)]:
            self.stddev = message.effort[message.name.index(self.joint)]

    def changed(self, wished, dt, message):
        """The wished speeds; zero after a push, or if the effort is unknown."""
        stop = np.zeros_like(wished)
        efforts = {} if message is None else dict(zip(message.name, message.effort, strict=False))
        effort = self.sign * efforts.get(self.joint, np.nan)
        if self.angle is None or not np.isfinite([self.angle, effort]).all():
            return stop, "stopped: the efforts or the joint's angle are unknown"
        if not np.isfinite(self.stddev):  # a push would not be noticed
            return stop, "stopped: the standard deviation of the efforts is unknown"
        if dt > 0.0:
            torque = self.observer.update(dt, self.angle, effort)
            if abs(torque) > self.threshold + 2.0 * self.stddev and not self.reason:
                self.reason = f"stopped by a push of {torque:.2f} N m; call ~/release to continue"
        return (stop, self.reason) if self.reason else (wished, "")

    def on_release(self, _request, response):
        """Release the motors."""
        response.success, response.message = True, self.reason or "the motors were not stopped"
        self.reason = ""
        return response


if __name__ == "__main__":
    spin(CollisionNode)
