"""The suspended parallel robot against closed forms: lengths over swivelling pulleys, weight."""

from math import acos, atan2, hypot, pi, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.model.prepared import load_model, shape_at

RADIUS, WINCH = 0.05, 0.5
"""Radius of pulleys, height of the winches [m]."""
PULLEYS = np.array(
    [
        [-7.1775, -5.4361, 5.3911], [-7.4594, -5.1504, 5.3999], [-7.3911, 5.1940, 5.3976],
        [-7.1026, 5.4753, 5.4094], [7.2398, 5.3759, 5.4093], [7.5208, 5.0851, 5.4200],
        [7.4461, -5.2539, 5.3874], [7.1608, -5.5342, 5.3973],
    ]
)  # fmt: skip
ANCHORS = np.array(
    [
        [0.5032, -0.4928, 0.0], [-0.5097, 0.3508, 0.9976], [-0.5032, -0.2700, 0.0],
        [0.4960, 0.3561, 0.9996], [-0.5032, 0.4928, 0.0], [0.4998, -0.3404, 0.9991],
        [0.5021, 0.2750, -0.0007], [-0.5045, -0.3463, 0.9976],
    ]
)  # fmt: skip
"""Points of the source's table I [m]."""
MASS, CENTRE = 91.058, np.array([-0.034, -0.013, 0.264])
"""Of the source's platform [kg, m]."""


def ends(pose):
    """Anchors relative to the platform's origin and in the base [m]."""
    arms = Rotation.from_euler("xyz", pose[3:]).apply(ANCHORS)
    return arms, arms + pose[:3]


def cable(pulley, anchor):
    """Length of a cable, and the unit vector in which it pulls the platform."""
    out = anchor[:2] - pulley[:2]
    plane = out / np.hypot(*out)
    x, down = float(np.hypot(*out)) - RADIUS, float(pulley[2] - anchor[2])
    free = sqrt(x**2 + down**2 - RADIUS**2)
    left = acos(RADIUS / hypot(x, down)) - atan2(down, x)  # where it leaves, above the horizontal
    wrap = pi - left
    point = RADIUS * np.array([np.cos(left), np.sin(left)])
    leaves = np.array([*(pulley[:2] + plane * (RADIUS + point[0])), pulley[2] + point[1]])
    assert abs(float(np.linalg.norm(leaves - anchor)) - free) < 1e-12
    return float(pulley[2]) - WINCH + RADIUS * wrap + free, (leaves - anchor) / free


def test_lengths_are_those_of_the_literature():
    model = load_model("cdpr")
    generator = np.random.default_rng(0)
    lower = np.array([joint.lower for joint in model.robot.joints])
    upper = np.array([joint.upper for joint in model.robot.joints])
    for pose in lower + generator.random((200, 6)) * (upper - lower):
        _, anchors = ends(pose)
        expected = [cable(p, a)[0] for p, a in zip(PULLEYS, anchors, strict=True)]
        found = shape_at(model, pose).length.reshape(8, 2).sum(axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_preloads_carry_the_platform():
    """At the reference pose; the file gives them to 0.1 N."""
    model = load_model("cdpr")
    pose = model.robot.reference_pose
    _, estimate = step(model, initial_state(model), Sample(1, np.zeros(8), pose))
    force = np.array([0.0, 0.0, MASS * 9.80665])
    expected = [*force, *np.cross(CENTRE, force)]
    np.testing.assert_allclose(estimate.joint_effort, expected, atol=0.2)
