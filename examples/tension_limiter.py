"""Slow the motors down before a cable's tension exceeds its limit.

    python3 tension_limiter.py --ros-args -p robot:=prototype -p limit:=80.0

Publish the wished speeds [rad/s], one per motor in the robot file's order, on /cdrj/wished/velocity
instead of /cdrj/commands/velocity.  The node forwards them unchanged while every element's tension
+ 2 sigma is far below its limit, reduces them near the limit and reverses the motor beyond it.  It
stops the motors if a tension is STALE, INVALID or UNSURE, or if none arrives.

After a start at rest the tensions are UNSURE until the robot has moved, because the direction of
friction at each pulley is unknown.  `-p creep_speed:=0.3` permits 0.3 rad/s in this state.
"""

import numpy as np
from between import Between, spin
from cdrj_msgs.msg import CableTensions

import cdrj_ros as cdrj

INVALID, STALE, UNSURE = CableTensions.INVALID, CableTensions.STALE, CableTensions.UNSURE

APPROACH_S = 0.05  # a tension approaches its limit as exp(-t / APPROACH_S), never faster


class TensionLimiter:
    """A barrier: d(tension)/dt <= (limit - tension - 2 sigma) / APPROACH_S for every element.

    Turning a drum by 1 rad increases a tension of its cable by at most EA / L times the drum's
    radius, which occurs when the joints are blocked.  This gives a bound of the motor's speed.
    """

    def __init__(self, model, limit=None, creep_speed=0.0):
        """Compute the cables' stiffness.

        Args:
            model: the prepared robot.
            limit: of every tension [N]; None: each cable's max_tension.
            creep_speed: largest speed while a tension is UNSURE [rad/s].
        """
        self.creep_speed = creep_speed
        cables, checked = model.robot.cables, cdrj.inspect_robot(model)
        counts = [len(cable.nodes) - 1 for cable in cables]
        self.cable_of = np.repeat(np.arange(len(counts)), counts)
        self.limit = np.array([limit or cable.maximum_tension for cable in cables])
        stiffness = [check.stiffness for check in checked.cables]  # [N/m]
        winding = np.array([motor.winding for motor in checked.motors])  # [m/rad]
        self.rise = (winding * stiffness).T  # [N/rad], shape (cables, motors)

    def allowed(self, wished, tension, stddev, status):
        """Permitted speeds [rad/s], shape (motors,), and the reason if they are reduced.

        Args:
            wished: desired speeds [rad/s], shape (motors,).
            tension, stddev, status: of every element, shape (elements,); empty: unknown.
        """
        stop = np.zeros_like(wished)
        known = len(tension) == len(stddev) == len(self.cable_of)
        if not known or not np.isfinite([tension, stddev]).all():
            return stop, "no tensions with standard deviations"
        if np.any(status & (STALE | INVALID)):
            return stop, "tensions are STALE or INVALID"
        reason = ""
        if np.any(status & UNSURE):
            reason = f"tensions are UNSURE; creep_speed is {self.creep_speed:g} rad/s"
            wished = np.clip(wished, -self.creep_speed, self.creep_speed)
        margin = np.full(len(self.limit), np.inf)
        np.minimum.at(margin, self.cable_of, self.limit[self.cable_of] - tension - 2.0 * stddev)
        speed = np.array(wished, dtype=float)
        for motor in range(speed.size):
            low, high = -np.inf, np.inf
            for room, rise in zip(margin, self.rise[:, motor], strict=True):
                if rise:
                    bound = room / (rise * APPROACH_S)
                    low, high = (low, min(high, bound)) if rise > 0 else (max(low, bound), high)
            speed[motor] = 0.0 if low > high else min(max(speed[motor], low), high)
        return speed, reason


class LimiterNode(Between):
    """Forwards the desired speeds, limited according to the last tensions."""

    def __init__(self, **options):
        super().__init__("tension_limiter", "velocity", CableTensions, "tensions", **options)
        limit = self.declare_parameter("limit", 0.0).value
        creep_speed = self.declare_parameter("creep_speed", 0.0).value
        self.limiter = TensionLimiter(self.model, limit, creep_speed)

    def changed(self, wished, _dt, message):
        """The speeds that the tensions allow."""
        if message is None:
            return np.zeros_like(wished), "stopped: no tensions"
        arrays = (np.array(part) for part in (message.tension, message.stddev, message.status))
        return self.limiter.allowed(wished, *arrays)


if __name__ == "__main__":
    spin(LimiterNode)
