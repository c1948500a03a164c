"""An encoder whose zero is off, in space: what a fresh file knows of it, and what a fit finds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml

from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import initial_state
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import Model, prepare
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
