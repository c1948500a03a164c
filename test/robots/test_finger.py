"""The finger against its structure matrix: moment arms of pulleys on the joints' axes."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.model.prepared import load_model, shape_at

CABLES = ("deep", "superficial", "extensor")
ELEMENTS = {"deep": slice(0, 5), "superficial": slice(5, 8), "extensor": slice(8, 13)}
BY_ANGLE = np.array([[-0.008, -0.006], [-0.009, 0.0], [0.010, 0.006]])
"""Length of every cable by mcp and pip [m/rad], read off the radii in the robot file."""


def test_a_cable_changes_its_length_by_radius_times_angle() -> None:
    model = load_model("finger")
    start = shape_at(model, np.zeros(2))
    generator = np.random.default_rng(4)
    lower = [joint.lower for joint in model.robot.joints]
    upper = [joint.upper for joint in model.robot.joints]
    for angle in generator.uniform(lower, upper, (200, 2)):
        shape = shape_at(model, angle)
        for k, cable in enumerate(CABLES):
            change = shape.length[ELEMENTS[cable]].sum() - start.length[ELEMENTS[cable]].sum()
            assert change == pytest.approx(float(BY_ANGLE[k] @ angle), abs=1e-12)
            arms = shape.lever_arm[ELEMENTS[cable]].sum(axis=0)
            np.testing.assert_allclose(arms, BY_ANGLE[k], atol=1e-12)


def test_the_preloads_balance_both_joints() -> None:
    preload = np.array([cable.preload for cable in load_model("finger").robot.cables])
    np.testing.assert_allclose(-BY_ANGLE.T @ preload, 0.0, atol=1e-12)
