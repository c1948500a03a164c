"""The prototype as a stack under ros2_control publishes it, and as angles and torques.

One message has the motors and joints of several robots, with prefixes; counts of an encoder on a
geared motor that turns the other way, currents as its efforts, and turns of the joint.
"""

from math import pi

import numpy as np

from support.places import PROTOTYPE

PLAIN = PROTOTYPE.read_text("utf-8")
GEAR, COUNTS, TORQUE_CONSTANT, EFFICIENCY = -50.0, 4096, 0.06, 0.9
SCALE = 2 * pi / COUNTS / GEAR
EFFORT_SCALE = TORQUE_CONSTANT * abs(GEAR) * EFFICIENCY
MOTOR, JOINT = "m/left.winch-1", "elbow 1:a+b"
PUBLISHED = (
    PLAIN.replace("name: prototype\n", "name: prototype\nprefix: arm1_\n")
    .replace("- name: winch", f"- name: {MOTOR}\n    scale: {SCALE!r}\n"
             f"    offset: 0.3\n    effort_scale: {EFFORT_SCALE!r}")
    .replace("- name: elbow", f"- name: {JOINT!r}\n    scale_deg: 360\n    offset: -0.1")
    .replace("motor: winch", f"motor: {MOTOR}").replace("joint: elbow", f"joint: {JOINT!r}")
    .replace("resolution_deg: 0.00439453125", "resolution: 1")
    .replace("resolution_deg: 0.02197265625", "resolution: 6.103515625e-05")
)  # fmt: skip
"""Robot file of the stack."""

NAMES = ("arm2_elbow 1:a+b", f"arm1_{JOINT}", "elbow", "arm1_gripper", f"arm1_{MOTOR}")
"""Names in a message; the axes of other robots move otherwise."""


def positions(winch, elbow):
    """Published positions, one per name, of two angles [rad]."""
    return [9.0 + winch, (elbow + 0.1) / (2 * pi), -elbow, 9.0, (winch - 0.3) / SCALE]


def efforts(torque):
    """Published efforts, one per name, of a torque of the winch [N m]."""
    return [7.0, 7.0, 7.0, 7.0, torque / EFFORT_SCALE]


def of_all(one, other):
    """Published positions over time, shape (n, names)."""
    return np.array([positions(a, b) for a, b in zip(one.tolist(), other.tolist(), strict=True)])
