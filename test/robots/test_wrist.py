"""The surgical wrist against its coupling matrix, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.model.prepared import load_model, shape_at

IDLER, JAW = 2.12e-3, 2.6e-3
"""Radii of the robot file [m]."""
COUPLING = np.array([[IDLER, -JAW, 0], [IDLER, JAW, 0], [-IDLER, 0, -JAW], [-IDLER, 0, JAW]])
"""Length of every cable by pitch, jaw_1 and jaw_2 [m/rad]."""


def per_cable(values: np.ndarray) -> np.ndarray:
    return values.reshape(4, 3, *values.shape[1:]).sum(axis=1)


def test_the_cables_follow_the_coupling_matrix_everywhere() -> None:
    model = load_model("wrist")
    start = per_cable(shape_at(model, np.zeros(3)).length)
    lower = [joint.lower for joint in model.robot.joints]
    upper = [joint.upper for joint in model.robot.joints]
    for pose in np.random.default_rng(0).uniform(lower, upper, (200, 3)):
        found = shape_at(model, pose)
        assert per_cable(found.length) - start == pytest.approx(COUPLING @ pose, abs=1e-14)
        assert per_cable(found.lever_arm) == pytest.approx(COUPLING, abs=1e-14)
