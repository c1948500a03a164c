"""The finger against its structure matrix: moment arms of pulleys on the joints' axes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Estimates
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import Model, prepare, shape_at

CABLES = ("deep", "superficial", "extensor")
ELEMENTS = {"deep": slice(0, 5), "superficial": slice(5, 8), "extensor": slice(8, 13)}
PULLEYS = {"deep": slice(0, 4), "superficial": slice(4, 6), "extensor": slice(6, 10)}
BY_ANGLE = np.array([[-0.008, -0.006], [-0.009, 0.0], [0.010, 0.006]])
"""Length of every cable by mcp and pip [m/rad], read off the radii in the robot file."""
DRUM = 0.006
MU = 0.12


def follow(joint: np.ndarray) -> np.ndarray:
    """Motor angles that wind the cable released by the joints, so that cables keep their length."""
    return -joint @ BY_ANGLE.T / DRUM


def grasp(path: Callable[..., np.ndarray]) -> np.ndarray:
    """Bend and stretch with the joints out of phase: the sample motion, shape (n, 2)."""
    mcp = path(1.0, 0.0, 0.6, 1.2, 0.3, 0.0)
    pip = path(1.0, 0.0, 0.9, 0.9, 1.1, 0.0)
    return np.stack([mcp, pip], axis=1)


def pull(n: int, part: float) -> np.ndarray:
    """More tension in all cables, in the ratio that leaves the joints balanced."""
    ramp = np.linspace(0.0, 1.0, n)
    return ramp[:, None] * np.array([0.05, 0.01, 0.05]) * part


def test_a_cable_changes_its_length_by_radius_times_angle(models: dict[str, Model]) -> None:
    model = models["finger"]
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


def test_the_preloads_balance_both_joints(models: dict[str, Model]) -> None:
    preload = np.array([cable.preload for cable in models["finger"].robot.cables])
    np.testing.assert_allclose(-BY_ANGLE.T @ preload, 0.0, atol=1e-12)


def test_without_friction_joint_torques_are_moment_arms_times_tensions(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    model = prepare(variant("finger", law="none"))
    joint = grasp(path)
    # the motors also pull differently, so that torques do not vanish
    more = 0.05 * np.sin(np.linspace(0.0, 9.0, len(joint)))[:, None] * np.array([1.0, 0.2, 0.7])
    _, estimates = drive(model, follow(joint) + pull(len(joint), 1.0) + more, joint)
    tension = estimates.values[:, model.layout.tension]
    first = tension[:, [ELEMENTS[cable].start for cable in CABLES]]
    for k, cable in enumerate(CABLES):
        along = tension[:, ELEMENTS[cable]] - first[:, [k]]
        np.testing.assert_allclose(along, 0.0, atol=1e-6)  # one tension per cable
    torque = estimates.values[:, model.layout.joint_effort]
    np.testing.assert_allclose(torque, -first @ BY_ANGLE, atol=1e-8)
    assert np.ptp(torque, axis=0).min() > 0.02
    motor = estimates.values[:, model.layout.motor_effort]
    np.testing.assert_allclose(motor, -DRUM * first, rtol=1e-9)  # the cables unwind the drums


def test_bending_one_joint_alone_changes_the_torques_of_both(
    variant: Callable, drive: Callable, path: Callable
) -> None:
    # coupled: holding the motors and bending pip tightens the extensor, which stretches mcp
    model = prepare(variant("finger", law="none"))
    joint = np.stack([np.zeros(201), path(0.4, 0.0, 0.01)], axis=1)
    _, estimates = drive(model, np.zeros((len(joint), 3)), joint)
    torque = estimates.values[-1, model.layout.joint_effort]
    stiffness = [
        cable.axial_stiffness / shape_at(model, np.zeros(2)).length[ELEMENTS[cable.name]].sum()
        for cable in model.robot.cables
    ]
    closed_form = -BY_ANGLE.T @ (stiffness * (BY_ANGLE @ np.array([0.0, 0.01])))
    np.testing.assert_allclose(torque, closed_form, rtol=0.01)
    assert np.all(torque < 0.0)


@pytest.fixture(scope="module")
def strokes(
    variant: Callable, drive: Callable, path: Callable
) -> tuple[Model, Samples, Estimates, int]:
    """Bend both joints and stretch them again, with capstan friction alone."""
    model = prepare(variant("finger", law="euler", mu_c=MU))
    joint = np.stack([path(1.0, 0.0, 1.2, 0.0), path(1.0, 0.0, 1.0, 0.0)], axis=1)
    samples, estimates = drive(model, follow(joint) + pull(len(joint), 0.1), joint)
    return model, samples, estimates, len(joint) // 2


@pytest.mark.parametrize(("cable", "when_bending"), [("deep", -1.0), ("extensor", 1.0)])
def test_bending_and_stretching_differ_by_the_capstan_factor(
    cable: str, when_bending: float, strokes: tuple[Model, Samples, Estimates, int]
) -> None:
    model, samples, estimates, turn = strokes
    tension = estimates.values[:, model.layout.tension][:, ELEMENTS[cable]]
    wrap = np.array(
        [shape_at(model, angle).wrap[PULLEYS[cable]].sum() for angle in samples.joint_angle]
    )
    measured = np.log(tension[:, -1] / tension[:, 0])
    bending = np.arange(150, turn - 50)
    stretching = np.arange(turn + 150, 2 * turn - 50)
    # As the finger bends, the motor winds a flexor in: the tension at the anchor is smaller by the
    # factor exp(-mu beta).  The finger pulls an extensor out: the tension there is larger.
    np.testing.assert_allclose(measured[bending], when_bending * MU * wrap[bending], rtol=2e-3)
    np.testing.assert_allclose(
        measured[stretching], -when_bending * MU * wrap[stretching], rtol=2e-3
    )
    half = turn // 2
    there = tension[half, -1] / tension[half, 0]
    back = tension[2 * turn - half, -1] / tension[2 * turn - half, 0]
    assert max(there, back) / min(there, back) == pytest.approx(
        np.exp(2.0 * MU * wrap[half]), rel=5e-3
    )


def test_the_unchanged_file_estimates_a_grasp(
    models: dict[str, Model], drive: Callable, path: Callable
) -> None:
    model = models["finger"]
    joint = grasp(path)
    _, estimates = drive(model, follow(joint) + pull(len(joint), 1.0), joint)
    tension = estimates.values[:, model.layout.tension]
    assert tension.min() > 2.0
    assert tension.max() < 60.0
