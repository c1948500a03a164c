"""The finger of the URDF against chains of rotations and circles in a plane."""

from __future__ import annotations

from collections.abc import Callable
from math import acos, atan2, cos, exp, hypot, radians, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cdrj_ros.commands.simulate import main as simulate
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.recordings import Topics

PROXIMAL, MIDDLE, RATIO = 0.03978, 0.02238, 0.66
"""Lengths of the URDF [m], and the last joint's angle over that before it."""
KNUCKLE, KNEE, LAST = 8e-3, 5.5e-3, 2.5e-3
"""Radii over which the extensor runs [m]."""
ELEMENTS = {"flexor": slice(0, 6), "extensor": slice(6, 10), "left": slice(10, 12)}
DRUM = 8e-3


def poses(model: Model) -> np.ndarray:
    lower = [joint.lower for joint in model.robot.joints]
    upper = [joint.upper for joint in model.robot.joints]
    return np.random.default_rng(0).uniform(lower, upper, (100, 3))


def grasp(path: Callable[..., np.ndarray]) -> np.ndarray:
    """The sample motion: the finger bends, moves aside and stretches, shape (n, 3)."""
    aside = path(0.6, 0.0, 0.0, 0.2, -0.15, 0.0)
    return np.stack([aside, path(0.6, 0, 1.0, 1.2, 0.4, 0), path(0.6, 0, 0.9, 1.2, 0.7, 0)], axis=1)


def test_the_joints_are_those_of_the_urdf(variant: Callable) -> None:
    robot = variant("finger3d")
    assert [joint.name for joint in robot.joints] == ["abduction", "mcp", "pip"]
    assert (robot.joints[1].lower, robot.joints[1].upper) == (0.0, 1.4)


def test_the_flexor_runs_straight_between_its_eyelets(variant: Callable) -> None:
    model = prepare(variant("finger3d"))
    for pose in poses(model):
        turned = Rotation.from_euler("ZY", [pose[0], pose[1]])
        bent = turned * Rotation.from_euler("y", pose[2])
        last = bent * Rotation.from_euler("y", RATIO * pose[2])
        knee = turned.apply([PROXIMAL, 0, 0])
        points = np.array(
            [
                [-0.010, 0, -0.009],
                turned.apply([0.009, 0, -0.009]),
                turned.apply([0.028, 0, -0.007]),
                knee + bent.apply([0.010, 0, -0.007]),
                knee + bent.apply([0.013, 0, -0.006]),
                knee + bent.apply([MIDDLE, 0, 0]) + last.apply([0.008, 0, -0.005]),
            ]
        )
        expected = 0.020 + 0.255 + np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        found = shape_at(model, pose)
        assert found.length[ELEMENTS["flexor"]].sum() == pytest.approx(expected, abs=1e-14)


def extensor(pose: np.ndarray) -> float:
    """Cable from the sheath over the knuckle, which it enters out of plane, to the last pulley."""
    aside, mcp, pip = pose
    x, y, z = -0.025 * cos(aside), 0.025 * sin(aside), 8e-3
    away = hypot(x, z)
    level = sqrt(away**2 - KNUCKLE**2)
    # angles seen from the left, from x towards z; the cable runs over the back
    enters = atan2(z, x) - acos(KNUCKLE / away)
    straight = sqrt(PROXIMAL**2 - (KNUCKLE - KNEE) ** 2)
    first = np.arcsin((KNUCKLE - KNEE) / PROXIMAL)
    leaves = np.pi / 2 - first - mcp
    second = np.arcsin((KNEE - LAST) / MIDDLE)
    at_knee = second - first + pip
    beyond = sqrt(MIDDLE**2 - (KNEE - LAST) ** 2)
    return float(
        hypot(level, y)
        + KNUCKLE * (enters - leaves)
        + straight
        + KNEE * at_knee
        + beyond
        + LAST * RATIO * pip
    )


def test_the_extensor_enters_the_groove_of_the_knuckle_out_of_plane(variant: Callable) -> None:
    model = prepare(variant("finger3d"))
    for pose in poses(model):
        found = shape_at(model, pose)
        assert found.length[ELEMENTS["extensor"]].sum() == pytest.approx(
            0.020 + 0.240 + extensor(pose), abs=1e-14
        )
        arms = found.lever_arm[ELEMENTS["extensor"]].sum(axis=0)
        assert arms[1:] == pytest.approx([KNUCKLE, KNEE + RATIO * LAST], abs=1e-14)


def test_the_sheath_loses_what_the_capstan_equation_says(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    model = prepare(variant("finger3d", law="euler", mu_c=0.08))
    joint = grasp(path)
    lengths = np.array([shape_at(model, pose).length for pose in joint])
    ends = [slice(0, 6), slice(6, 10), slice(10, 12), slice(12, 14)]
    whole = np.stack([lengths[:, part].sum(axis=1) for part in ends], axis=1)
    _, estimates = drive(model, (whole[0] - whole) / DRUM, joint)
    tension = estimates.values[:, model.layout.tension]
    loss = exp(-0.08 * radians(50.0))
    ratio = tension[:, 1] / tension[:, 0]  # of the flexor's sheath
    assert ratio.min() == pytest.approx(loss, rel=1e-3)
    assert ratio.max() == pytest.approx(1.0 / loss, rel=1e-3)


def test_the_unchanged_file_estimates_the_sample_motion(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    model = prepare(variant("finger3d"))
    joint = grasp(path)
    lengths = np.array([shape_at(model, pose).length for pose in joint])
    starts = [0, 6, 10, 12]
    whole = np.add.reduceat(lengths, starts, axis=1)
    _, estimates = drive(model, (whole[0] - whole) / DRUM, joint)
    tension = estimates.values[:, model.layout.tension]
    assert 1.0 < tension.min() < tension.max() < 40.0


def test_the_rigs_force_on_a_sheath_is_that_of_both_pulls(tmp_path: Path) -> None:
    """A sheath turns the cable by more than the angle between its ends."""
    bag = str(tmp_path / "bag")
    assert simulate([bag, "--robot", "finger3d", "--duration", "2", "--cells", "2"]) == 0
    compared = validate_bag(load_model("finger3d"), bag, Topics())
    forces = {one.name: one for one in compared.channels if one.name.startswith("nodal_force")}
    assert {"nodal_force/flexor/2", "nodal_force/left/2"} < set(forces)
    for one in forces.values():
        assert np.abs(one.estimate - one.reference).mean() < 0.2, one.name
