"""Keep antagonistic cables as loose as possible without letting one go slack.

    python3 keep_taut.py --ros-args -p robot:=finger -p floor:=2.0

Publish the motor angles that position the joints [rad], one per motor in the robot file's order, on
/cdrj/wished/position instead of /cdrj/commands/position.  The node adds a co-contraction: it winds
all cables in, or pays all out, in proportions that do not move the joints.  Co-contraction
increases quickly when an element's tension - 2 sigma is below the floor, and decreases slowly
otherwise.  If tensions must not be used, the robot file's preloads slowly return.  The tensions of
the finger as shipped are UNSURE, because its file states no accuracies: there the node holds the
preloads until the file has been identified (docs/estimation.md).
"""

import numpy as np
from between import Between, spin
from cdrj_msgs.msg import CableTensions

import cdrj_ros as cdrj

REFUSED = CableTensions.STALE | CableTensions.INVALID | CableTensions.UNSURE
LOOSEN_S = 2.0  # time constant [s]


class KeepTaut:
    """Feedback of the smallest tension to the co-contraction of all motors."""

    def __init__(self, model, floor=2.0, tighten_s=0.008):
        """Derive the direction of co-contraction.

        If the preloads balance in the reference pose, so does every multiple of them.  The motors
        therefore turn such that every cable is stretched in proportion to its preload.

        Args:
            model: the prepared robot; every motor winds one cable, which has a preload.
            floor: desired lower bound of every tension minus 2 sigma [N].
            tighten_s: time constant with which co-contraction increases [s]; a motor that is slow
                beside it makes the tensions overshoot.
        """
        cables, checked = model.robot.cables, cdrj.inspect_robot(model)
        counts = [len(cable.nodes) - 1 for cable in cables]
        self.floor, self.tighten_s, self.elements = floor, tighten_s, sum(counts)
        preload = np.array([cable.preload for cable in cables])
        shorter = preload / [check.stiffness for check in checked.cables]  # to double it [m]
        winding = np.array([motor.winding for motor in checked.motors])  # [m/rad]
        wound = np.argmax(np.abs(winding), axis=1)  # the cable of every motor
        self.turn = shorter[wound] / winding[np.arange(len(wound)), wound]
        """Angle of every motor that doubles the preloads [rad]."""
        self.strength = np.repeat(preload, counts)
        self.share = 0.0
        """Co-contraction: every cable's preload is 1 + share times that of the robot file."""

    def update(self, dt, tension, stddev, status):
        """Advance by ``dt`` [s]; returns angles to add to the motors' [rad], shape (motors,).

        Args:
            dt: time since the last call [s].
            tension, stddev, status: of every element, shape (elements,); empty: unknown.
        """
        known = len(tension) == len(stddev) == self.elements
        if not known or np.any(status & REFUSED) or not np.isfinite([tension, stddev]).all():
            missing = -self.share
        else:
            missing = float(np.max((self.floor - tension + 2.0 * stddev) / self.strength))
        self.share += missing * min(dt / (self.tighten_s if missing > 0.0 else LOOSEN_S), 1.0)
        self.share = min(max(self.share, -0.9), 4.0)
        return self.turn * self.share


class TautNode(Between):
    """Adds the co-contraction to the wished angles."""

    def __init__(self, **options):
        super().__init__("keep_taut", "position", CableTensions, "tensions", **options)
        floor = self.declare_parameter("floor", 2.0).value
        tighten_s = self.declare_parameter("tighten_s", 0.008).value
        self.law = KeepTaut(self.model, floor, tighten_s)

    def changed(self, wished, dt, message):
        """The angles with the present co-contraction."""
        if message is None:
            unknown = np.array([])
            added = self.law.update(dt, unknown, unknown, unknown)
            return wished + added, "the robot file's preloads are being restored"
        arrays = (np.array(part) for part in (message.tension, message.stddev, message.status))
        return wished + self.law.update(dt, *arrays), ""

    def released(self):
        """Begin with the robot file's preloads when switched on again."""
        self.law.share = 0.0


if __name__ == "__main__":
    spin(TautNode)
