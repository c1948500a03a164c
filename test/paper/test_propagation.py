"""All tensions of a cable from known ones: equal to the truth where the cable slips, intervals
where it may be stuck."""

from __future__ import annotations

from math import exp, pi
from pathlib import Path as File

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Estimates, initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import load_robot, parse_robot
from examples.paper.propagation import (
    KnownTension,
    Path,
    PropagatedTensions,
    path_of,
    propagate,
)

PROTOTYPE = File(__file__).parents[2] / "config" / "robots" / "prototype.yaml"
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


def test_no_pulley_counts_as_sliding_while_the_joint_rests(prototype: Robot) -> None:
    model = prepare(prototype)
    rest = np.zeros(400)
    motor = 0.1 * np.sin(np.linspace(0.0, 20.0, 400))  # only the winch moves, undetected
    at_rest = model, *estimated(model, motor, rest)
    result = from_element(at_rest, "upper/8")
    assert not result.sliding[:, :6].any()
    true = tensions(at_rest)[:, :8]
    assert np.all((true >= result.lower - 1e-6) & (true <= result.upper + 1e-6))


SIDES = """
name: sides
motors: [{name: m}, {name: k}]
joints: [{name: q, range: [-1, 1]}]
friction: {law: euler, mu_c: 0.2}
cables:
  - name: c
    axial_stiffness: 1.0e+9
    preload: 30
    nodes: [%s]
    spans: [0.5, 0.3, %s]
"""
PULLEYS = (
    "{type: pulley, radius: 0.01, wrap_angle: 1.5}, {type: pulley, radius: 0.01, wrap_angle: 2}"
)
WINCH, OTHER = (f"{{type: winch, motor: {m}, winding: 1, radius: 0.015}}" for m in "mk")
STRAND = "{joint: q, offset: 0.4, slope: 0.1}"


@pytest.mark.parametrize(
    ("ends", "strand", "joint", "motor", "expected"),
    [
        # the strand behind the pulleys grows: cable runs towards the last node, which pulls
        ((WINCH, "{type: anchor}"), STRAND, 0.5, 0.0, 1),
        ((WINCH, "{type: anchor}"), STRAND, -0.5, 0.0, -1),
        # held at the first node, no cable passes the pulleys: the winch at the end supplies it
        (("{type: anchor}", OTHER), STRAND, 0.5, 0.0, 0),
        # a winch at either end: the cable that the last one draws in comes over the pulleys
        ((WINCH, OTHER), "0.4", 0.0, 2.0, 1),
        ((WINCH, OTHER), "0.4", 0.0, -2.0, -1),
        ((WINCH, OTHER), STRAND, -0.3, 2.0 + 0.3 * 0.1 / 0.015, 1),
    ],
)
def test_slip_directions_follow_from_the_lengths_behind_the_pulleys(
    ends: tuple[str, str], strand: str, joint: float, motor: float, expected: int
) -> None:
    text = SIDES % (f"{ends[0]}, {PULLEYS}, {ends[1]}", strand)
    text = text.replace("motors: [{name: m}, {name: k}]", _motors(ends))
    model = prepare(parse_robot(text))
    stamps = EPOCH_NS + np.arange(500) * STEP_NS
    share = np.linspace(0.0, 1.0, 500)[:, None]
    motors = np.zeros((500, len(model.layout.motors)))
    motors[:, -1:] = motor * share
    path = path_of(model, stamps, joint * share, motors)
    result = propagate(model, path, [KnownTension("c/2", np.full(500, 10.0), 0.1)])
    middle = slice(100, 400)
    assert np.all(result.sliding[middle] == expected)
    if expected == 0:
        return
    eta = exp(-0.2 * 1.5), exp(-0.2 * 2.0)
    first = 10.0 * eta[0] ** expected
    last = 10.0 * eta[1] ** -expected
    np.testing.assert_allclose(result.tension[middle, 0], first, rtol=1e-6)
    np.testing.assert_allclose(result.tension[middle, 2], last, rtol=1e-6)


def _motors(ends: tuple[str, str]) -> str:
    names = [name for name in "mk" if f"motor: {name}" in "".join(ends)]
    return "motors: [" + ", ".join(f"{{name: {name}}}" for name in names) + "]"


def test_what_cannot_be_propagated_is_refused(swept: Run) -> None:
    model, path = swept[0], path_through(swept)
    good = tensions(swept)[:, 7]
    cases: list[tuple[list[KnownTension], str]] = [
        ([], "propagation needs at least one tension sensor"),
        (
            [KnownTension("upper/9", good, 0.1)],
            "there is no element upper/9; the robot has upper/1",
        ),
        ([KnownTension("upper/8", good[:-1], 0.1)], "has 5999 readings for 6000 samples"),
        ([KnownTension("upper/8", good, 0.0)], "stddev of upper/8 must be positive"),
        (
            [KnownTension("upper/8", good, 0.1), KnownTension("lower/8", good, 0.1)],
            "lower/8 and upper/8 are not in one cable",
        ),
    ]
    for known, message in cases:
        with pytest.raises(UsageError, match=message):
            propagate(model, path, known)
    two_winches = prepare(parse_robot(SIDES % (f"{WINCH}, {PULLEYS}, {OTHER}", "0.4")))
    with pytest.raises(UsageError, match="two winches: its motor angles are needed"):
        path_of(two_winches, np.arange(2), np.zeros((2, 1)))
