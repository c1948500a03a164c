"""The suspended parallel robot against closed forms: lengths over swivelling pulleys, wrench."""

from __future__ import annotations

from collections.abc import Callable
from math import acos, atan2, hypot, pi, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from cdrj_ros.model.prepared import Model, prepare, shape_at

RADIUS, DRUM, WINCH = 0.05, 0.0675, 0.5
"""Radii of pulleys and drums, height of the winches [m]."""
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


def ends(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Anchors relative to the platform's origin and in the base [m]."""
    arms = Rotation.from_euler("xyz", pose[3:]).apply(ANCHORS)
    return arms, arms + pose[:3]


def cable(pulley: np.ndarray, anchor: np.ndarray) -> tuple[float, np.ndarray]:
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


def tour(path: Callable[..., np.ndarray]) -> np.ndarray:
    """The sample motion: through the workspace and back, turning, shape (n, 6)."""
    legs = (
        (0.0, 2.4, -1.8, 0.0), (0.0, -1.2, 1.2, 0.0), (1.5, 2.6, 0.8, 1.5),
        (0.0, 0.1, -0.1, 0.0), (0.0, -0.1, 0.12, 0.0), (0.0, 0.15, 0.1, 0.0),
    )  # fmt: skip
    return np.stack([path(2.0, *leg) for leg in legs], axis=1)


def follow(model: Model, joint: np.ndarray) -> np.ndarray:
    """Motor angles that keep the length of every cable, in addition to some tension."""
    lengths = np.array([shape_at(model, pose).length.reshape(8, 2).sum(axis=1) for pose in joint])
    return (lengths[0] - lengths) / DRUM


def test_lengths_are_those_of_the_literature() -> None:
    from cdrj_ros.model.loading import load_model

    model = load_model("cdpr")
    generator = np.random.default_rng(0)
    lower = np.array([joint.lower for joint in model.robot.joints])
    upper = np.array([joint.upper for joint in model.robot.joints])
    for pose in lower + generator.random((200, 6)) * (upper - lower):
        _, anchors = ends(pose)
        expected = [cable(p, a)[0] for p, a in zip(PULLEYS, anchors, strict=True)]
        found = shape_at(model, pose).length.reshape(8, 2).sum(axis=1)
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_efforts_are_the_static_wrench_of_the_cables(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    model = prepare(variant("cdpr", law="none"))
    joint = tour(path)[::5]
    _, estimates = drive(model, follow(model, joint) + 0.002, joint)
    layout = model.layout
    for values, pose in zip(estimates.values[::20], joint[::20], strict=True):
        arms, anchors = ends(pose)
        tension = values[layout.tension].reshape(8, 2)[:, 1]
        assert tension.min() > 150.0
        pulls = tension[:, None] * [cable(p, a)[1] for p, a in zip(PULLEYS, anchors, strict=True)]
        force, moment = pulls.sum(axis=0), np.cross(arms, pulls).sum(axis=0)
        # roll turns about the platform's x, pitch about the turned y, yaw about z
        axes = [
            Rotation.from_euler("ZY", [pose[5], pose[4]]).apply([1, 0, 0]),
            Rotation.from_euler("z", pose[5]).apply([0, 1, 0]),
            np.array([0.0, 0.0, 1.0]),
        ]
        expected = [*force, *(moment @ axis for axis in axes)]
        np.testing.assert_allclose(values[layout.joint_effort], expected, atol=1e-7)


def test_the_preloads_carry_the_platform(variant: Callable, drive: Callable) -> None:
    """At the reference pose; the file gives them to 0.1 N."""
    model = prepare(variant("cdpr", law="none"))
    pose = np.array([joint.reference_angle for joint in model.robot.joints])
    _, estimates = drive(model, np.zeros((3, 8)), np.tile(pose, (3, 1)))
    force = np.array([0.0, 0.0, MASS * 9.80665])
    expected = [*force, *np.cross(CENTRE, force)]
    np.testing.assert_allclose(estimates.values[-1, model.layout.joint_effort], expected, atol=0.2)


def test_friction_of_the_pulleys_opposes_the_motion(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    """On its way down a platform is lighter to the winches than on its way up."""
    model = prepare(variant("cdpr"))
    joint = tour(path)[::5].copy()
    joint[:, [0, 1, 3, 4, 5]] = 0.0
    _, estimates = drive(model, follow(model, joint), joint)
    tension = estimates.values[:, model.layout.tension].reshape(-1, 8, 2)
    speed = np.gradient(joint[:, 2])
    rising, sinking = speed > 0.7 * speed.max(), speed < 0.7 * speed.min()
    at_winch_over_platform = tension[:, :, 0] / tension[:, :, 1]
    assert np.all(at_winch_over_platform[rising] > 1.005)
    assert np.all(at_winch_over_platform[sinking] < 0.995)
