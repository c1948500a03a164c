"""The parallel robot compared with the static wrench balance of its platform."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin

import numpy as np
import pytest

from cdrj_ros.model.prepared import Model, prepare, shape_at

PULLEYS = np.array([[0.60, 0.40], [-0.60, 0.40], [-0.60, -0.40], [0.60, -0.40]])
ANCHORS = np.array([[0.06, -0.04], [-0.06, -0.04], [-0.06, 0.04], [0.06, 0.04]])
TURNS = np.array([1, -1, 1, -1])
"""Centres and anchors [m] as in the robot file, and the sense of each cable around its pulley."""
RADIUS = 0.020
DRUM = 0.025


def leaving_point(centre: np.ndarray, turn: int, anchor: np.ndarray) -> np.ndarray:
    """Point at which a cable leaves a pulley tangentially towards an anchor.

    Of the two points of tangency, the one at which motion around the pulley in the cable's sense
    is directed towards the anchor.
    """
    away = anchor - centre
    distance = float(np.hypot(*away))
    at_centre = np.arccos(RADIUS / distance)  # between the centre line and the radius
    for side in (at_centre, -at_centre):
        direction = np.arctan2(away[1], away[0]) + side
        radius = RADIUS * np.array([cos(direction), sin(direction)])
        travel = turn * np.array([-radius[1], radius[0]])
        if travel @ (anchor - centre - radius) > 0.0:
            return centre + radius
    raise AssertionError("no tangent")


def cables_at(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Anchors relative to the platform's origin and unit vectors from them, shape (4, 2) each."""
    x, y, phi = pose
    turned = ANCHORS @ np.array([[cos(phi), sin(phi)], [-sin(phi), cos(phi)]])
    units = []
    for arm, centre, turn in zip(turned, PULLEYS, TURNS, strict=True):
        anchor = np.array([x, y]) + arm
        towards = leaving_point(centre, int(turn), anchor) - anchor
        units.append(towards / np.hypot(*towards))
    return turned, np.array(units)


def wrench(pose: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """Force [N] and torque [N m] of the cables on the platform: sum of t u and of r x t u."""
    arms, units = cables_at(pose)
    force = tension @ units
    torque = tension @ (arms[:, 0] * units[:, 1] - arms[:, 1] * units[:, 0])
    return np.array([*force, torque])


def tour(path: Callable[..., np.ndarray]) -> np.ndarray:
    """Translation and rotation of the platform, as in the sample motion; shape (n, 3)."""
    x = path(1.0, 0.0, 0.20, -0.20, -0.10, 0.0)
    y = path(1.0, 0.0, 0.10, 0.12, -0.12, 0.0)
    phi = path(1.0, 0.0, 0.10, -0.15, 0.05, 0.0)
    return np.stack([x, y, phi], axis=1)


def follow(model: Model, joint: np.ndarray) -> np.ndarray:
    """Motor angles that keep every cable's length, from the geometry."""
    length = np.array([shape_at(model, pose).length.reshape(4, 2).sum(axis=1) for pose in joint])
    return (length[0] - length) / DRUM


@pytest.mark.parametrize("law", ["none", "elastoplastic"])
def test_efforts_are_the_static_wrench_of_the_cables(
    law: str, variant: Callable, drive: Callable, path: Callable
) -> None:
    model = prepare(variant("parallel", law=law))
    joint = tour(path)
    wave = np.sin(np.linspace(0.0, 12.0, len(joint)))[:, None] * np.array(
        [0.024, -0.016, 0.02, 0.012]
    )
    _, estimates = drive(model, follow(model, joint) + wave, joint)
    tension = estimates.values[:, model.layout.tension].reshape(-1, 4, 2)
    effort = estimates.values[:, model.layout.joint_effort]
    size = 0.0
    for k in range(0, len(joint), 25):
        expected = wrench(joint[k], tension[k, :, 1])  # of the elements that end at the platform
        np.testing.assert_allclose(effort[k], expected, atol=1e-9)
        # virtual work over elements that end amid an arc would differ by half of the friction
        wrap_by = wraps_by_pose(model, joint[k])
        lump = 0.5 * RADIUS * wrap_by.T @ (tension[k, :, 1] - tension[k, :, 0])
        size = max(size, float(np.abs(lump[:2]).max()))
    if law != "none":
        assert size > 0.01  # [N]; the efforts are of the order of 10 N
    assert np.abs(effort[:, :2]).max() > 5.0
    assert np.abs(effort[:, 2]).max() > 0.3


def wraps_by_pose(model: Model, pose: np.ndarray) -> np.ndarray:
    """Derivatives of the four wraps by x, y [rad/m] and phi [-], by central differences."""
    step = 1e-6
    columns = [
        (shape_at(model, pose + step * e).wrap - shape_at(model, pose - step * e).wrap) / (2 * step)
        for e in np.eye(3)
    ]
    return np.stack(columns, axis=1)


def test_the_virtual_work_of_tensions_and_of_the_wrench_agree(models: dict[str, Model]) -> None:
    model = models["parallel"]
    generator = np.random.default_rng(8)
    for _ in range(100):
        pose = generator.uniform([-0.25, -0.15, -0.2], [0.25, 0.15, 0.2])
        tension = generator.uniform(5.0, 80.0, 4)
        move = generator.normal(size=3) * np.array([1e-6, 1e-6, 1e-5])
        ahead, behind = shape_at(model, pose + move), shape_at(model, pose - move)
        change = (ahead.length - behind.length).reshape(4, 2).sum(axis=1)
        work = -tension @ change
        assert work == pytest.approx(2.0 * wrench(pose, tension) @ move, rel=1e-4, abs=1e-9)


def test_equal_preloads_hold_the_platform_in_the_middle() -> None:
    np.testing.assert_allclose(wrench(np.zeros(3), np.full(4, 30.0)), 0.0, atol=1e-12)


def test_in_all_poses_all_cables_can_be_tight_without_a_load(models: dict[str, Model]) -> None:
    for pose in np.array(np.meshgrid([-0.25, 0, 0.25], [-0.15, 0, 0.15], [-0.2, 0, 0.2])).T.reshape(
        -1, 3
    ):
        matrix = np.array([wrench(pose, unit) for unit in np.eye(4)]).T
        null = np.linalg.svd(matrix)[2][-1]
        null = null / null[np.argmax(np.abs(null))]
        assert null.min() > 0.1, pose


def test_with_friction_the_tensions_at_winch_and_platform_differ(
    models: dict[str, Model], variant: Callable, drive: Callable, path: Callable
) -> None:
    joint = tour(path)
    tension = {}
    for law in ("none", "elastoplastic"):
        model = prepare(variant("parallel", law=law))
        _, estimates = drive(model, follow(model, joint), joint)
        tension[law] = estimates.values[:, model.layout.tension].reshape(-1, 4, 2)
    difference = np.ptp(tension["none"], axis=2)
    assert difference.max() < 1e-6
    model = models["parallel"]
    outward = np.diff(follow(model, joint), axis=0) < -1e-4  # the platform pulls cable out
    with_friction = tension["elastoplastic"][1:]
    ahead = with_friction[:, :, 1] > with_friction[:, :, 0]
    assert np.mean(ahead[outward]) > 0.95  # all samples but those shortly after a reversal
