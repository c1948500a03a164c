"""The robots of config/robots, variants without friction, and motions at a balance of forces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Estimates, initial_state, run, step
from cdrj_ros.estimation.samples import Sample, Samples
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Pulley, Robot
from cdrj_ros.robot.reader import load_robot

ROBOTS = Path(__file__).parents[2] / "config" / "robots"
EPOCH_NS = 1_700_000_000_000_000_000
RATE = 500.0
"""Samples per second [Hz]."""

Variant = Callable[..., Robot]
Drive = Callable[..., tuple[Samples, Estimates]]
Balance = Callable[..., tuple[np.ndarray, np.ndarray]]


def named(name: str) -> Robot:
    return load_robot(ROBOTS / f"{name}.yaml")


@pytest.fixture(scope="session")
def variant() -> Variant:
    """A robot of config/robots with another friction law, or other friction at all pulleys."""

    def make(name: str, law: str = "elastoplastic", **friction: Any) -> Robot:
        robot = named(name)
        cables = tuple(
            replace(
                cable,
                law=law,
                nodes=tuple(
                    replace(node, friction=replace(node.friction, **friction))
                    if isinstance(node, Pulley)
                    else node
                    for node in cable.nodes
                ),
            )
            for cable in robot.cables
        )
        return replace(robot, cables=cables)

    return make


@pytest.fixture(scope="session")
def drive() -> Drive:
    """Run the estimator over motor and joint angles, shape (n, motors) and (n, joints)."""

    def make(model: Model, motor: np.ndarray, joint: np.ndarray) -> tuple[Samples, Estimates]:
        stamps = EPOCH_NS + np.round(np.arange(len(joint)) / RATE * 1e9).astype(np.int64)
        samples = Samples(stamps, np.ascontiguousarray(motor), np.ascontiguousarray(joint))
        _, estimates = run(model, initial_state(model), samples)
        assert np.all(estimates.values[:, model.layout.status] == 0), "slack, overload or invalid"
        assert np.all(np.isfinite(estimates.values))
        return samples, estimates

    return make


@pytest.fixture(scope="session")
def balance() -> Balance:
    """Motor angle of a robot with one motor and one joint that gives the wanted joint effort.

    The angle is found for each sample by bisection with the estimator's own ``step``, which gives
    the motion of a machine that carries a load.  Returns motor angles and estimates.
    """

    def make(model: Model, joint: np.ndarray, effort: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        state = initial_state(model)
        motors, estimates = [], []
        angle = 0.0
        for k, (position, wanted) in enumerate(zip(joint, effort, strict=True)):
            stamp = EPOCH_NS + round(k / RATE * 1e9)

            def missing(
                motor: float, stamp: int = stamp, q: float = position, w: float = wanted
            ) -> float:
                sample = Sample(stamp, np.array([motor]), np.array([q]))
                return float(step(model, state, sample)[1].joint_effort[0]) - w  # noqa: B023

            # bracket the angle, then bisect: because of friction the curve is not smooth
            width = 1e-4
            low = high = angle
            while missing(low) > 0.0 and width < 10.0:
                low -= width
                width *= 2.0
            width = 1e-4
            while missing(high) < 0.0 and width < 10.0:
                high += width
                width *= 2.0
            for _ in range(60):
                middle = 0.5 * (low + high)
                if missing(middle) < 0.0:
                    low = middle
                else:
                    high = middle
            angle = high
            sample = Sample(stamp, np.array([angle]), np.array([position]))
            state, estimate = step(model, state, sample)
            motors.append(angle)
            estimates.append(estimate.values)
        return np.array(motors), np.array(estimates)

    return make


@pytest.fixture(scope="session")
def models() -> dict[str, Model]:
    names = ("hoist", "finger")
    return {name: prepare(named(name)) for name in names}


def smooth(duration: float, *points: float) -> np.ndarray:
    """A motion from point to point; each leg starts and ends at rest, and the speed never jumps."""
    leg = np.arange(round(duration * RATE)) / (duration * RATE)
    ease = leg * leg * (3.0 - 2.0 * leg)
    parts = [a + (b - a) * ease for a, b in pairwise(points)]
    return np.concatenate([*parts, points[-1:]])


@pytest.fixture(scope="session")
def path() -> Callable[..., np.ndarray]:
    return smooth
