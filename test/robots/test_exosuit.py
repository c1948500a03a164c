"""The exosuit's sheath against the capstan equation, its elbow against plane trigonometry."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, radians, sin

import numpy as np
import pytest

from cdrj_ros.model.prepared import Model, prepare, shape_at

MU, BEND, DRUM = 0.13, radians(150.0), 0.018
ELBOW, EXIT, CUFF = np.array([0.0, -0.326]), np.array([0.06, -0.20]), np.array([0.055, -0.13])


def free_cable(angle: float) -> tuple[float, float]:
    """Length from the sheath to the cuff and its distance from the elbow's axis [m]."""
    turned = np.array(
        [cos(angle) * CUFF[0] - sin(angle) * CUFF[1], sin(angle) * CUFF[0] + cos(angle) * CUFF[1]]
    )
    way = ELBOW + turned - EXIT
    length = float(np.hypot(*way))
    lever = EXIT - ELBOW
    return length, float(lever[0] * way[1] - lever[1] * way[0]) / length


def bends(path: Callable[..., np.ndarray]) -> np.ndarray:
    """The sample motion: the elbow bends and stretches twice."""
    low, high = radians(5.0), radians(100.0)
    return path(1.0, low, high, radians(40.0), high, low)


def follow(model: Model, joint: np.ndarray) -> np.ndarray:
    lengths = np.array([shape_at(model, np.array([angle])).length.sum() for angle in joint])
    return (lengths[0] - lengths) / DRUM


def test_length_and_moment_arm_are_those_of_the_triangle(variant: Callable) -> None:
    model = prepare(variant("exosuit"))
    to_sheath = float(np.linalg.norm([0.0, 0.03, 0.12]))
    for angle in np.radians(np.linspace(5.0, 110.0, 22)):
        shape = shape_at(model, np.array([angle]))
        free, lever = free_cable(angle)
        assert shape.length.sum() == pytest.approx(to_sheath + 0.52 + free, abs=1e-14)
        assert abs(shape.lever_arm.sum()) == pytest.approx(abs(lever), abs=1e-14)
        assert shape.lever_arm.sum() < -0.02  # the cable bends the elbow
        assert shape.wrap[0] == pytest.approx(BEND)


def test_a_pulling_motor_loses_what_the_capstan_equation_says(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    model = prepare(variant("exosuit"))
    joint = bends(path)
    motor = follow(model, joint) + path(1.0, 0.0, 0.3, 0.3, 0.3, 0.3)
    _, estimates = drive(model, motor[:, None], joint[:, None])
    before, after = estimates.values[:, model.layout.tension].T
    speed = np.gradient(joint)
    bending, stretching = speed > 0.5 * speed.max(), speed < 0.5 * speed.min()
    assert bending.sum() > 100
    assert after[bending] / before[bending] == pytest.approx(exp(-MU * BEND), rel=1e-3)
    assert before[stretching] / after[stretching] == pytest.approx(exp(-MU * BEND), rel=1e-3)
    effort = estimates.values[:, model.layout.joint_effort][:, 0]
    levers = np.array([abs(free_cable(angle)[1]) for angle in joint])
    assert effort == pytest.approx(after * levers, rel=1e-9)
