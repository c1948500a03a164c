"""Cables that stiffen as their strands bed in, (E21), and that yield with time, (E24)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.optimize import brentq

from cdrj_ros.estimation.estimator import Estimates, Sample, Samples, initial_state, run, step
from cdrj_ros.model.laws import Elasticity, modulus_at, secant_at, strain_at, tensions_at
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import parse_robot

Vector = NDArray[np.float64]

LAW = Elasticity(6000.0, 0.004, 8.0)
TENSIONS = np.array([0.0, 1e-9, 1e-3, 0.5, 8.0, 60.0, 2000.0])

STRAND = """
name: strand
motors: [{{name: m}}]
joints: []
cables:
  - name: c
    axial_stiffness: 6000
    {bedding}
    preload: 5
    nodes: [{{type: winch, motor: m, radius: 0.01, winding: 1}}, {{type: anchor}}]
    spans: [2.0]
uncertainty: {{others: exact{uncertain}}}
"""
BEDDING = "bedding_strain: 0.004\n    bedding_tension: 8"


def strand(bedding: str = BEDDING, uncertain: str = "") -> Robot:
    return parse_robot(STRAND.format(bedding=bedding, uncertain=uncertain))


def strain_of(t: Any, law: Elasticity = LAW) -> Any:
    """(E21) as it is printed."""
    return t / law.axial_stiffness + law.bedding_strain * t / (t + law.bedding_tension)


@pytest.mark.parametrize("strain", [0.0, 0.05, 1.0])
@pytest.mark.parametrize("tension", [1e-3, 8.0, 4e4])
def test_tension_and_strain_are_inverse_for_soft_and_for_stiff_bedding(
    strain: float, tension: float
) -> None:
    law = Elasticity(6000.0, strain, tension)
    np.testing.assert_allclose(strain_at(law, TENSIONS), strain_of(TENSIONS, law), rtol=1e-15)
    back = tensions_at(law, strain_at(law, TENSIONS))
    np.testing.assert_allclose(back, TENSIONS, rtol=1e-11, atol=1e-12)


def test_the_slope_is_the_derivative_and_rises_from_soft_to_ea() -> None:
    for t in TENSIONS[3:]:
        h = 1e-5 * t
        slope = 2.0 * h / (strain_of(t + h) - strain_of(t - h))
        assert modulus_at(LAW, float(t)) == pytest.approx(slope, rel=1e-7)
    moduli = modulus_at(LAW, TENSIONS)
    assert np.all(np.diff(moduli) > 0.0)
    assert moduli[0] == pytest.approx(1.0 / (1.0 / 6000.0 + 0.004 / 8.0))
    assert moduli[-1] == pytest.approx(6000.0, rel=1e-4)
    assert secant_at(LAW, 8.0) == pytest.approx(8.0 / strain_of(8.0))


def wound(robot: Robot, angles: Vector) -> tuple[Estimates, Vector]:
    """Estimates of a strand between a winch and an anchor, and its material at every sample [m]."""
    model = prepare(robot)
    state, materials, rows = initial_state(model), [], []
    for k, angle in enumerate(angles):
        state, estimate = step(model, state, Sample(1 + k * 10**6, np.array([angle]), np.zeros(0)))
        materials.append(float(state.values[2]))
        rows.append(estimate.values)
    stamps = np.arange(angles.size, dtype=np.int64)
    return Estimates(stamps, np.array(rows), model.layout), np.array(materials)


def test_one_element_has_the_tension_of_the_closed_form() -> None:
    """The drum takes cable at the strain of its winding: r dphi = (1 + eps) dl, L fixed."""
    estimates, material = wound(strand(), np.linspace(0.0, 3.0, 30001))
    first = 2.0 / (1.0 + strain_of(5.0))
    assert material[0] == pytest.approx(first, rel=1e-14)
    # l' = -r l / L: the material falls exponentially with the angle
    assert material[-1] == pytest.approx(first * np.exp(-0.01 * 3.0 / 2.0), rel=1e-8)
    expected = brentq(lambda t: strain_of(t) - (2.0 / material[-1] - 1.0), 0.0, 1e3, xtol=1e-13)
    assert estimates.values[-1, 0] == pytest.approx(expected, rel=1e-12)
    assert estimates.values[-1, 0] > 60.0


PULLED = """
name: pulled
motors: [{name: m}]
joints: [{name: slide, range: [-1, 1]}]
cables:
  - name: c
    axial_stiffness: 6000
    bedding_strain: 0.004
    bedding_tension: 8
    preload: 5
    nodes: [{type: winch, motor: m, radius: 0.01, winding: 1}, {type: anchor}]
    spans: [{joint: slide, offset: 2.0, slope: 1.0}]
uncertainty: {others: exact}
"""


def test_a_cycle_returns_the_work_that_it_took() -> None:
    model = prepare(parse_robot(PULLED))
    there = 0.03 * np.sin(np.linspace(0.0, 0.5 * np.pi, 2001))
    course = np.concatenate([there, there[-2::-1]])
    state, effort, tension = initial_state(model), [], []
    for k, slide in enumerate(course):
        sample = Sample(1 + k * 10**6, np.zeros(1), np.array([slide]))
        state, estimate = step(model, state, sample)
        effort.append(estimate.joint_effort[0])
        tension.append(estimate.tension[0])
    np.testing.assert_allclose(tension, tension[::-1], rtol=1e-12)
    work = -trapezoid(effort[: there.size], there)
    assert trapezoid(effort, course) == pytest.approx(0.0, abs=1e-12)

    def stored(t: float) -> float:  # the integral of T d(eps), per unstretched length
        ratio = t / 8.0
        return float(t**2 / 12000.0 + 0.004 * 8.0 * (np.log1p(ratio) - ratio / (1.0 + ratio)))

    material = 2.0 / (1.0 + strain_of(5.0))
    assert max(tension) > 60.0
    assert work == pytest.approx(material * (stored(max(tension)) - stored(5.0)), rel=1e-5)


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
