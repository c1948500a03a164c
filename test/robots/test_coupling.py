"""Finger and wrist against their coupling matrices, in closed form."""

import numpy as np
import pytest

from cdrj_ros.model.prepared import load_model, shape_at

FINGER = np.array([[-0.008, -0.006], [-0.009, 0.0], [0.010, 0.006]])
"""Length of deep, superficial and extensor by mcp and pip [m/rad], from the file's radii."""
IDLER, JAW = 2.12e-3, 2.6e-3
"""Radii of the wrist's file [m]."""
WRIST = np.array([[IDLER, -JAW, 0], [IDLER, JAW, 0], [-IDLER, 0, -JAW], [-IDLER, 0, JAW]])
"""Length of every cable by pitch, jaw_1 and jaw_2 [m/rad]."""


@pytest.mark.parametrize(("name", "coupling"), [("finger", FINGER), ("wrist", WRIST)])
def test_cables_follow_the_coupling_matrix_everywhere(name, coupling):
    model = load_model(name)
    joints, parts = model.robot.joints, model.robot.parts

    def per_cable(values):
        return np.array([values[part].sum(axis=0) for part in parts])

    start = per_cable(shape_at(model, np.zeros(len(joints))).length)
    lower, upper = [one.lower for one in joints], [one.upper for one in joints]
    for pose in np.random.default_rng(0).uniform(lower, upper, (200, len(joints))):
        found = shape_at(model, pose)
        assert per_cable(found.length) - start == pytest.approx(coupling @ pose, abs=1e-14)
        assert per_cable(found.lever_arm) == pytest.approx(coupling, abs=1e-14)


def test_the_preloads_of_the_finger_balance_both_joints():
    preload = np.array([cable.preload for cable in load_model("finger").robot.cables])
    np.testing.assert_allclose(-FINGER.T @ preload, 0.0, atol=1e-12)
