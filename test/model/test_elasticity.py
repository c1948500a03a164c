"""Cables that stiffen as their strands bed in: (E21), from a single element to whole robots."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.optimize import brentq, root
from support.core_laws import solve_cable

from cdrj_ros._core import Law, element_tension, tolerance
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Estimates, initial_state, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.cable_records import CONTACT, SEGMENT
from cdrj_ros.model.elasticity import (
    Elasticity,
    elasticity_of,
    modulus_at,
    secant_at,
    strain_at,
    tensions_at,
)
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import parse_robot
from examples.paper.stiffness import exact_stiffness

Vector = NDArray[np.float64]

LAW = Elasticity(6000.0, 0.004, 8.0)
LINEAR = Elasticity(6000.0)
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


def test_below_zero_strain_the_law_goes_on_with_its_slope_at_zero() -> None:
    strain = np.array([-0.01, -1e-6])
    expected = strain * modulus_at(LAW, 0.0)
    np.testing.assert_allclose(tensions_at(LAW, strain), expected)
    np.testing.assert_allclose(strain_at(LAW, expected), strain)
    assert element_tension(LAW, 0.99, 1.0) == 0.0


def test_without_bedding_nothing_changes_by_a_bit() -> None:
    lengths = np.linspace(0.9, 1.1, 41)
    for length in lengths:
        assert element_tension(LINEAR, length, 1.0) == max(6000.0 * (length - 1.0), 0.0)
    tension = TENSIONS[1:]
    assert np.array_equal(strain_at(LINEAR, tension), tension / 6000.0)
    assert np.array_equal(modulus_at(LINEAR, tension), np.full(tension.size, 6000.0))
    assert np.array_equal(tensions_at(LINEAR, lengths - 1.0), 6000.0 * (lengths - 1.0))


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


def chain(count: int, seed: int) -> tuple[Any, Any]:
    """A taut chain of segments and contacts that rub and move, in no particular state."""
    generator = np.random.default_rng(seed)
    segments, contacts = np.zeros(count + 1, SEGMENT), np.zeros(count, CONTACT)
    length = generator.uniform(0.05, 0.3, count + 1)
    segments["length_before"], segments["length"] = length, length * (1.0 + 1e-4)
    segments["material_before"] = length / (1.0 + strain_of(generator.uniform(4.0, 9.0, count + 1)))
    contacts["loss"] = generator.uniform(0.02, 0.3, count)
    contacts["stiffness"], contacts["breakaway"] = 2e4, 0.4
    contacts["shift"] = generator.normal(size=count) * 1e-5
    return segments, contacts


@pytest.mark.parametrize("seed", range(6))
def test_the_solver_finds_the_root_that_scipy_finds(seed: int) -> None:
    segments, contacts = chain(4, seed)
    entered = (-1.0) ** seed * 2e-4
    before = segments["material_before"].copy()

    def tensions(flux: Vector) -> Vector:
        material = before - np.diff(np.concatenate([[entered], flux, [0.0]]))
        strain = segments["length"] / material - 1.0
        return np.array([brentq(lambda t, e=e: strain_of(t) - e, 0.0, 1e4) for e in strain])

    def imbalance(flux: Vector) -> Vector:
        t, slip = tensions(flux), flux + contacts["shift"]
        bound = contacts["loss"] * np.maximum(t[:-1], t[1:]) + 1e-9
        knee, reach = 0.4 * bound, 0.6 * bound / 2e4
        beyond = np.maximum(np.abs(slip) - knee / 2e4, 0.0)
        force = np.where(
            beyond > 0.0, bound - (bound - knee) * np.exp(-beyond / reach), 2e4 * np.abs(slip)
        )
        return np.diff(t) - np.sign(slip) * force

    worst = solve_cable(LAW, segments, contacts, entered, 0.0, Law.elastoplastic, 0.0)[1]
    assert worst <= tolerance(LAW)
    assert np.abs(contacts["flux"]).max() > 1e-5
    other = root(imbalance, 0.9 * contacts["flux"], tol=1e-12)
    assert np.abs(other.fun).max() < 1e-6
    np.testing.assert_allclose(segments["tension"], tensions(other.x), atol=1e-5)
    np.testing.assert_allclose(contacts["flux"], other.x, atol=1e-9)


def test_a_well_bedded_chain_converges_as_fast_as_a_linear_one() -> None:
    """The derivative is exact: with a wrong one, Newton's method would be linear, not quadratic."""
    for seed in range(6):
        counts = []
        for law in (LAW, LINEAR):
            segments, contacts = chain(8, seed)
            counts.append(solve_cable(law, segments, contacts, 1e-4, 0.0, Law.none, 0.0)[0])
        assert counts[0] <= counts[1] + 4, counts


def test_the_stiffness_of_an_element_is_the_derivative_of_its_tension() -> None:
    tension = np.array([2.0, 30.0])
    length = np.array([0.2, 0.1])
    material = length / (1.0 + strain_of(tension))
    by_length, by_material = exact_stiffness(LAW, length, tension)
    for k in range(2):
        for expected, dx, dl in ((by_length[k], 1e-8, 0.0), (by_material[k], 0.0, -1e-8)):
            up = element_tension(LAW, length[k] + dx, material[k] + dl)
            down = element_tension(LAW, length[k] - dx, material[k] - dl)
            assert (up - down) / 2e-8 == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("key", "stddev"), [("bedding_strain", 4e-5), ("bedding_tension", 0.2)])
def test_the_ensemble_gives_the_finite_difference(key: str, stddev: float) -> None:
    uncertain = f", parameters: [cables.c.{key}], stddev: [{stddev}], drums: hold"
    robot = strand(uncertain=uncertain)
    model = prepare(robot)
    spread, state = Ensemble(model), initial_state(model)
    angles = np.append(np.linspace(0.0, 1.0, 1001), np.ones(50))
    found = 0.0
    for k, angle in enumerate(angles):
        sample = Sample(1 + k * 10**7, np.array([angle]), np.zeros(0))
        state, estimate = step(model, state, sample)
        found = float(spread.update(sample, estimate)[0])
    cable = robot.cables[0]
    ends = [
        wound(replace(robot, cables=(replace(cable, **{key: getattr(cable, key) + d}),)), angles)[0]
        for d in (-stddev, stddev)
    ]
    expected = 0.5 * abs(ends[1].values[-1, 0] - ends[0].values[-1, 0])
    assert expected > 1e-4
    assert found == pytest.approx(expected, rel=0.02)


def test_a_robot_starts_with_its_preload_in_every_element(prototype: Robot) -> None:
    cables = tuple(
        replace(cable, bedding_strain=0.003, bedding_tension=10.0) for cable in prototype.cables
    )
    model = prepare(replace(prototype, cables=cables))
    _, estimate = step(model, initial_state(model), Sample(1, np.zeros(1), np.zeros(1)))
    np.testing.assert_allclose(estimate.tension[:8], cables[0].preload, rtol=1e-12)
    np.testing.assert_allclose(estimate.tension[8:], cables[1].preload, rtol=1e-12)
    assert elasticity_of(cables[0]) == Elasticity(cables[0].axial_stiffness, 0.003, 10.0)


def test_bedding_strain_needs_its_tension() -> None:
    with pytest.raises(RobotFileError, match=r"cables\[0\].bedding_tension is missing"):
        strand("bedding_strain: 0.004")
    with pytest.raises(RobotFileError, match=r"bedding_strain must be.* got -0.1"):
        strand("bedding_strain: -0.1\n    bedding_tension: 8")
    assert strand("bedding_strain: 0").cables[0].bedding_strain == 0.0
