"""The fitted robot file of a real instrument, and how far the estimator is from its recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.bag import Topics
from cdrj_ros.commands.validate import validate_bag
from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.estimation.metrics import pooled_errors
from cdrj_ros.model.plan import Model, prepare
from cdrj_ros.model.robot_file import load_robot, parse_robot

ROOT = Path(__file__).resolve().parents[1]
ROBOT = ROOT / "config" / "robots" / "davinci_jaw.yaml"
RECORDINGS = ROOT.parent / "shared" / "data" / "davinci" / "validate"

SPINDLE_RADIUS = 5e-3
POSE = np.array([0.5])
"""The spindle in the reference pose [rad]."""


@pytest.fixture(scope="module")
def model() -> Model:
    return prepare(load_robot(ROBOT))


def efforts_without_friction(spindle: float, jaw: float) -> tuple[float, float, float]:
    """Torque on the spindle, torque that holds the jaw, tension of a less that of b."""
    text = ROBOT.read_text(encoding="utf-8").replace("law: elastoplastic", "law: none")
    model = prepare(parse_robot(text))
    sample = Sample(1, np.array([spindle]), np.array([jaw]))
    _, estimate = step(model, initial_state(model), sample)
    tension = dict(zip(estimate.layout.elements, estimate.tension, strict=True))
    difference = tension["a/1"] - tension["b/1"]
    return float(estimate.motor_effort[0]), float(estimate.joint_effort[0]), float(difference)


def test_the_file_describes_a_spindle_two_cables_and_a_jaw(model: Model) -> None:
    robot = model.robot
    assert [motor.name for motor in robot.motors] == ["spindle"]
    assert [joint.name for joint in robot.joints] == ["jaw"]
    assert [cable.name for cable in robot.cables] == ["a", "b"]


def test_both_cables_have_their_preload_in_the_reference_pose(model: Model) -> None:
    sample = Sample(1, POSE, np.array([model.robot.joints[0].reference_angle]))
    _, estimate = step(model, initial_state(model), sample)
    preloads = np.repeat([cable.preload for cable in model.robot.cables], 3)
    np.testing.assert_allclose(estimate.tension, preloads, rtol=1e-9)


@pytest.mark.parametrize("lag", [-0.05, 0.05])
def test_torques_are_the_difference_of_tensions_times_the_radii(model: Model, lag: float) -> None:
    rest = model.robot.joints[0].reference_angle
    spindle, jaw, difference = efforts_without_friction(0.5, rest + lag)
    radius = model.robot.cables[0].spans[-1][0].slope[0]  # length by jaw angle
    assert np.sign(difference) == np.sign(lag)
    assert spindle == pytest.approx(-difference * SPINDLE_RADIUS)
    assert jaw == pytest.approx(difference * radius)


def test_a_load_that_closes_the_jaw_is_felt_at_the_spindle(model: Model) -> None:
    rest = model.robot.joints[0].reference_angle
    spindle, jaw, _ = efforts_without_friction(0.5, rest - 0.1)
    assert jaw < 0.0 < spindle


@pytest.mark.skipif(
    not RECORDINGS.is_dir(),
    reason=f"the recordings are not there: {RECORDINGS.relative_to(ROOT.parent)} beside the "
    "repository (see config/robots/davinci_jaw.yaml for their origin)",
)
def test_torques_of_runs_that_were_not_fitted_are_explained(model: Model) -> None:
    bags = sorted(entry for entry in RECORDINGS.iterdir() if entry.is_dir())
    errors = pooled_errors([validate_bag(model, str(bag), Topics()) for bag in bags])
    for channel in ("effort/spindle", "effort/jaw"):
        r2 = errors[channel].r2
        assert r2 is not None
        assert r2 >= 0.94, f"{channel}: R² {r2:.4f}"
