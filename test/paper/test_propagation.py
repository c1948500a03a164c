"""All tensions of a cable from known ones: equal to the truth where the cable slips, intervals
where it may be stuck."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from support.places import PROTOTYPE

from cdrj_ros.estimation.estimator import Estimates, initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import load_robot
from examples.paper.propagation import (
    KnownTension,
    Path,
    PropagatedTensions,
    path_of,
    propagate,
)

EPOCH_NS = 1_700_000_000_000_000_000
STEP_NS = 2_000_000

Run = tuple[Model, Samples, Estimates]


def estimated(model: Model, motor: np.ndarray, joint: np.ndarray) -> tuple[Samples, Estimates]:
    stamps = EPOCH_NS + np.arange(len(motor)) * STEP_NS
    samples = Samples(stamps, motor.reshape(len(motor), -1), joint.reshape(len(motor), -1))
    return samples, run(model, initial_state(model), samples)[1]


def tensions(run: Run) -> np.ndarray:
    _, _, estimates = run
    return estimates.values[:, estimates.layout.tension]


def path_through(run: Run) -> Path:
    model, samples, _ = run
    return path_of(model, samples.stamp_ns, samples.joint_angle, samples.motor_angle)


def from_element(run: Run, element: str, stddev: float = 1e-4) -> PropagatedTensions:
    model = run[0]
    known = tensions(run)[:, model.layout.elements.index(element)]
    return propagate(model, path_through(run), [KnownTension(element, known, stddev)])


@pytest.fixture(scope="module")
def prototype() -> Robot:
    return load_robot(PROTOTYPE)


def sweep(robot: Robot) -> Run:
    """A joint that moves back and forth with its winch, after a rest."""
    model = prepare(robot)
    time = np.arange(6000) * STEP_NS * 1e-9
    moving = np.maximum(time - 1.0, 0.0)
    joint = 0.6 * np.sin(2.0 * pi * 0.2 * moving)
    motor = 8.0 * np.sin(joint) + 0.15 * np.sin(2.0 * pi * 0.2 * moving)
    samples, estimates = estimated(model, motor, joint)
    return model, samples, estimates


@pytest.fixture(scope="module")
def swept(prototype: Robot) -> Run:
    return sweep(prototype)


@pytest.mark.parametrize("element", ["upper/8", "upper/1", "upper/4", "lower/6"])
def test_where_every_pulley_slides_any_element_gives_all_the_others(
    swept: Run, element: str
) -> None:
    result = from_element(swept, element)
    columns = [swept[0].layout.elements.index(name) for name in result.elements]
    true = tensions(swept)[:, columns]
    sliding = (result.sliding != 0).all(axis=1)
    assert sliding.mean() > 0.1
    assert np.ptp(true[sliding] / true[sliding][:, :1], axis=0).max() > 0.2, "both directions"
    off = (np.abs(result.tension - true) / (true + 1.0))[sliding]
    assert np.percentile(off, 99) < 1e-3
    assert off.max() < 2e-3, "elasticity's share of the slip speed"
    # the nodal forces are the estimator's too
    layout = swept[0].layout
    pulleys = [layout.pulleys.index(name) for name in result.pulleys]
    force = swept[2].values[:, layout.magnitude][:, pulleys]
    off = (np.abs(result.nodal_force - force) / (force + 1.0))[sliding]
    assert np.percentile(off, 99) < 2e-3


@pytest.mark.parametrize("element", ["upper/8", "upper/1", "upper/4", "lower/6"])
def test_the_truth_lies_within_the_bounds_whichever_pulleys_are_stuck(
    swept: Run, element: str
) -> None:
    result = from_element(swept, element)
    columns = [swept[0].layout.elements.index(name) for name in result.elements]
    true = tensions(swept)[:, columns]
    inside = (true >= result.lower * 0.998 - 0.01) & (true <= result.upper * 1.002 + 0.01)
    assert inside.mean() > 0.9998
    layout = swept[0].layout
    force = swept[2].values[:, layout.magnitude]
    force = force[:, [layout.pulleys.index(name) for name in result.pulleys]]
    inside = (force >= result.nodal_force_lower * 0.995 - 1e-2) & (
        force <= result.nodal_force_upper * 1.005 + 1e-2
    )
    assert inside.mean() > 0.9998
    stuck = (result.sliding == 0).all(axis=1)
    width = (result.upper - result.lower).max(axis=1)
    known = true[:, result.elements.index(element)]
    assert np.all(width[stuck] >= 0.1 * known[stuck]), "a stuck cable leaves much open"
    assert np.all(width[(result.sliding != 0).all(axis=1)] < 1e-9)
