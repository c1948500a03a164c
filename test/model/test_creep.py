"""Cables that yield with time, (E24), against closed solutions of a single element."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import parse_robot

Vector = NDArray[np.float64]

EA, PRELOAD, SPAN, RADIUS = 6000.0, 30.0, 2.0, 0.01
ROPE = f"""
name: rope
motors: [{{name: m}}]
joints: []
cables:
  - name: c
    axial_stiffness: {EA:g}
    %s
    preload: {PRELOAD:g}
    nodes: [{{type: winch, motor: m, radius: {RADIUS}, winding: 1}}, {{type: anchor}}]
    spans: [{SPAN}]
uncertainty: {{others: exact%s}}
"""
SHARE, TAU, FLOW = 0.4, 5.0, 50.0
CREEP = f"creep_share: {SHARE}\n    creep_time: {TAU:g}"


def rope(creep: str = CREEP, uncertain: str = "") -> Robot:
    return parse_robot(ROPE % (creep, uncertain))


def tensions(model: Model, angle: Vector, dt: float) -> Vector:
    """Tension of the rope while the winch turns by ``angle`` [rad], samples ``dt`` [s] apart."""
    stamps = 1 + np.round(1e9 * dt * np.arange(angle.size)).astype(np.int64)
    samples = Samples(stamps, angle[:, None], np.zeros((angle.size, 0)))
    return run(model, initial_state(model), samples)[1].values[:, model.layout.tension][:, 0]


@pytest.mark.parametrize("dt", [0.001, 0.1, 3.0])
def test_a_rope_that_is_pulled_and_held_relaxes(dt: float) -> None:
    """In closed form, for steps of any size: T falls by a share c / (1 + c) of the rise."""
    pulled = 0.2
    angle = np.full(round(30.0 / dt) + 2, pulled)
    angle[0] = 0.0
    found = tensions(prepare(rope()), angle, dt)
    assert found[0] == pytest.approx(PRELOAD, rel=1e-12)
    time = dt * np.arange(angle.size - 1)
    at_once = found[1] / EA
    settled = (at_once + SHARE * PRELOAD / EA) / (1.0 + SHARE)
    strain = settled + (at_once - settled) * np.exp(-(1.0 + SHARE) * time / TAU)
    np.testing.assert_allclose(found[1:], EA * strain, rtol=2e-3)  # strains add up exactly in (E24)
    assert found[-1] == pytest.approx(EA * settled, rel=2e-3)
    lost = (found[1] - found[-1]) / (found[1] - PRELOAD)
    assert lost == pytest.approx(SHARE / (1.0 + SHARE), rel=0.01)


def test_a_flowing_rope_loses_its_tension_for_good() -> None:
    model = prepare(rope(f"flow_time: {FLOW:g}"))
    found = tensions(model, np.zeros(10_001), 0.01)
    np.testing.assert_allclose(found, PRELOAD * np.exp(-0.01 * np.arange(10_001) / FLOW), rtol=1e-9)


def test_a_slack_rope_recovers() -> None:
    """Pulled for long, let go for long: it is as long as before."""
    angle = np.concatenate([[0.0], np.full(3000, 1.0), np.full(6000, -1.5), np.zeros(6000)])
    found = tensions(prepare(rope()), angle, 0.01)
    assert found[5000] == 0.0
    at_once = PRELOAD * (1.0 + SHARE)
    assert found[9001] == pytest.approx(at_once, rel=0.02), "all delayed strain is gone"
    assert found[-1] == pytest.approx(PRELOAD, rel=0.02)
