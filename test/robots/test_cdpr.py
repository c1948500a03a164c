"""The suspended parallel robot against closed forms: lengths over swivelling pulleys, wrench."""

from __future__ import annotations

from collections.abc import Callable
from math import acos, atan2, hypot, pi, sqrt

import numpy as np
from scipy.spatial.transform import Rotation

from cdrj_ros.model.prepared import Model, prepare, shape_at

RADIUS, DRUM = 0.08, 0.06
TOP, FLOOR = 3.5, 0.2
PULLEYS = np.array(
    [[2.7, 2], [3, 1.7], [-2.7, 2], [-3, 1.7], [-2.7, -2], [-3, -1.7], [2.7, -2], [3, -1.7]]
)
ANCHORS = np.array(
    [
        [0.4, -0.3, -0.25], [-0.4, 0.3, 0.25], [-0.4, -0.3, -0.25], [0.4, 0.3, 0.25],
        [-0.4, 0.3, -0.25], [0.4, -0.3, 0.25], [0.4, 0.3, -0.25], [-0.4, -0.3, 0.25],
    ]
)  # fmt: skip
"""Points of the robot file [m]."""


def ends(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Anchors relative to the platform's origin and in the base [m]."""
    arms = Rotation.from_euler("xyz", pose[3:]).apply(ANCHORS)
    return arms, arms + pose[:3]


def cable(pulley: np.ndarray, anchor: np.ndarray) -> tuple[float, np.ndarray]:
    """Length of a cable, and the unit vector in which it pulls the platform."""
    out = anchor[:2] - pulley
    plane = out / np.hypot(*out)
    x, down = float(np.hypot(*out)) - RADIUS, TOP - float(anchor[2])
    free = sqrt(x**2 + down**2 - RADIUS**2)
    left = acos(RADIUS / hypot(x, down)) - atan2(down, x)  # where it leaves, above the horizontal
    wrap = pi - left
    point = RADIUS * np.array([np.cos(left), np.sin(left)])
    leaves = np.array([*(pulley + plane * (RADIUS + point[0])), TOP + point[1]])
    assert abs(float(np.linalg.norm(leaves - anchor)) - free) < 1e-12
    return TOP - FLOOR + RADIUS * wrap + free, (leaves - anchor) / free


def tour(path: Callable[..., np.ndarray]) -> np.ndarray:
    """The sample motion: through the workspace and back, turning, shape (n, 6)."""
    legs = (
        (0.0, 0.8, -0.6, 0.0), (0.0, -0.4, 0.4, 0.0), (1.0, 1.4, 0.8, 1.0),
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
