"""An encoder whose zero is off, in space: what a fresh file knows of it, and what a fit finds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml

from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.foundation.series import Series
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import fitted_along, parse_unknowns
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import narrowed
from truth import robots

OFF = np.radians(1.3)
"""Error of the zero of the joint [rad]; the file's standard deviation of it is 1 degree."""
SCENE = robots.skew_cylinders(9.0, 125)
STAMPS = 1_000_000_000 + np.round(SCENE.time * 1e9).astype(np.int64)
READ = SCENE.joint - np.array([OFF, 0.0])
KNOWN = SCENE.time >= SCENE.cycle


@pytest.fixture(scope="module")
def tension() -> np.ndarray:
    return SCENE.truth().tension


def tared() -> Any:
    """The scene's file with nothing stated, after a tare: its references are what is read."""
    document = yaml.safe_load(SCENE.robot_file())
    document.pop("uncertainty", None)
    for joint, read in zip(document["joints"], READ.T, strict=True):
        joint["range"] = [float(read.min()) - 0.1, float(read.max()) + 0.1]
        joint["reference_angle"] = float(read[0])
    return document


def estimated(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Tensions and standard deviations after the first cycle."""
    samples = Samples(STAMPS, SCENE.motor.copy(), READ.copy())
    _, found = Ensemble(model).run(initial_state(model), samples)
    assert found.stddev is not None
    tensions = found.values[KNOWN][:, model.layout.tension]
    return tensions, found.stddev[KNOWN][:, : tensions.shape[1]]


def test_a_fresh_file_knows_what_the_zero_of_an_encoder_does(tension: np.ndarray) -> None:
    document = tared()
    robot = build_robot(document, "test")
    zeros = [f"joints.{joint.name}.{key}" for joint in robot.joints
             for key in ("reference_angle", "offset")]  # fmt: skip
    known = narrowed(robot, dict.fromkeys(zeros[::2], 0.0))
    assert known is not None
    at = [known.parameters.index(path) for path in zeros]
    covariance = known.covariance[np.ix_(at, at)]
    stddev = np.sqrt(np.diag(covariance))
    correlation = (covariance / np.outer(stddev, stddev)).round(9)
    alone = {"others": "exact", "parameters": zeros, "stddev": stddev.tolist(),
             "correlation": correlation.tolist()}  # fmt: skip
    found, spread = estimated(prepare(build_robot({**document, "uncertainty": alone}, "test")))
    error = np.abs(found - tension[KNOWN])
    assert error.mean() > 0.1 * tension[KNOWN].mean()
    assert np.mean(error <= 2.0 * spread) > 0.95
    assert np.median(spread) < 1.5 * np.median(error), "not by a width that covers everything"
    without = {**document, "uncertainty": {"others": "exact"}}
    found, spread = estimated(prepare(build_robot(without, "test")))
    assert np.mean(np.abs(found - tension[KNOWN]) <= 2.0 * spread) < 0.5


def test_a_fit_to_a_load_cell_finds_the_zero_of_the_encoder_along(tension: np.ndarray) -> None:
    document = tared()
    robot = build_robot(document, "test")
    element = robot.cables[0].element_names[-1]
    cell = tension[:, -1] + np.random.default_rng(0).normal(0.0, 0.1, SCENE.time.size)
    motors = {name: Series(STAMPS, STAMPS, read) for name, read in
              zip(SCENE.motors, SCENE.motor.T, strict=True)}  # fmt: skip
    joints = {name: Series(STAMPS, STAMPS, np.ascontiguousarray(read)) for name, read in
              zip(SCENE.joints, READ.T, strict=True)}  # fmt: skip
    recorded = Recorded("cell", motors, joints, {f"tension/{element}": (STAMPS, cell)})
    named = parse_unknowns(document, "preload")
    along = fitted_along(document, robot.uncertainty, named)
    found = identify(document, "test", named + along, [recorded], Settings(coarse=True))
    names = [unknown.name for unknown in found.unknowns]
    k = names.index(f"joints.{SCENE.joints[0]}.offset")
    assert found.values[k] == pytest.approx(OFF, abs=3.0 * found.stddev[k])
    assert found.stddev[k] < 0.8 * np.radians(1.0)
    model = prepare(build_robot(with_numbers(document, found.by_path), "test"))
    samples = Samples(STAMPS, SCENE.motor.copy(), READ + model.robot.offsets[1:])
    _, estimates = run(model, initial_state(model), samples)
    error = np.abs(estimates.values[:, model.layout.tension] - tension)[KNOWN]
    assert error.mean() < 0.01 * tension[KNOWN].mean()
