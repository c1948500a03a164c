"""The surgical wrist against its coupling matrix, in closed form."""

from __future__ import annotations

from collections.abc import Callable
from math import exp

import numpy as np
import pytest

from cdrj_ros.model.prepared import prepare, shape_at

IDLER, JAW, DRUM = 2.12e-3, 2.6e-3, 3.166e-3
"""Radii of the robot file [m]."""
COUPLING = np.array([[IDLER, -JAW, 0], [IDLER, JAW, 0], [-IDLER, 0, -JAW], [-IDLER, 0, JAW]])
"""Length of every cable by pitch, jaw_1 and jaw_2 [m/rad]."""


def sweep(path: Callable[..., np.ndarray]) -> np.ndarray:
    """The sample motion: pitch and both jaws, opening and closing, shape (n, 3)."""
    pitch = path(0.5, 0.0, 0.9, -0.6, 0.4, 0.0)
    first = path(0.5, 0.0, 0.6, 1.0, -0.3, 0.0)
    second = path(0.5, 0.0, -0.2, 0.8, -0.5, 0.0)
    return np.stack([pitch, first, second], axis=1)


def follow(joint: np.ndarray) -> np.ndarray:
    """Drum angles that wind in what the joints release."""
    return -joint @ COUPLING.T / DRUM


def per_cable(values: np.ndarray) -> np.ndarray:
    return values.reshape(4, 3, *values.shape[1:]).sum(axis=1)


def test_the_cables_follow_the_coupling_matrix_everywhere(variant: Callable) -> None:
    model = prepare(variant("wrist"))
    start = per_cable(shape_at(model, np.zeros(3)).length)
    lower = [joint.lower for joint in model.robot.joints]
    upper = [joint.upper for joint in model.robot.joints]
    for pose in np.random.default_rng(0).uniform(lower, upper, (200, 3)):
        found = shape_at(model, pose)
        assert per_cable(found.length) - start == pytest.approx(COUPLING @ pose, abs=1e-14)
        assert per_cable(found.lever_arm) == pytest.approx(COUPLING, abs=1e-14)


def test_friction_holds_back_what_the_idlers_bound_says(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    model = prepare(variant("wrist", law="euler", mu_c=0.15))
    joint = sweep(path)
    joint[:, 0] = 0.0
    _, estimates = drive(model, follow(joint), joint)
    tension = estimates.values[:, model.layout.tension].reshape(-1, 4, 3)
    wrap = shape_at(model, np.zeros(3)).wrap.reshape(4, 2).sum(axis=1)
    ratio = tension[:, 0, 2] / tension[:, 0, 0]
    assert ratio.min() == pytest.approx(exp(-0.15 * wrap[0]), rel=1e-3)
    assert ratio.max() == pytest.approx(exp(0.15 * wrap[0]), rel=1e-3)
