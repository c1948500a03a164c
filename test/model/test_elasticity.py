"""Cables that stiffen as their strands bed in, (E21), and that yield with time, (E24)."""

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.laws import Elasticity, modulus_at, secant_at, strain_at, tensions_at
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

LAW = Elasticity(6000.0, 0.004, 8.0)
TENSIONS = np.array([0.0, 1e-9, 1e-3, 0.5, 8.0, 60.0, 2000.0])


def strain_of(t, law=LAW):
    """(E21) as it is printed."""
    return t / law.axial_stiffness + law.bedding_strain * t / (t + law.bedding_tension)


@pytest.mark.parametrize("strain", [0.0, 0.05, 1.0])
@pytest.mark.parametrize("tension", [1e-3, 8.0, 4e4])
def test_tension_and_strain_are_inverse_for_soft_and_for_stiff_bedding(strain, tension):
    law = Elasticity(6000.0, strain, tension)
    np.testing.assert_allclose(strain_at(law, TENSIONS), strain_of(TENSIONS, law), rtol=1e-15)
    back = tensions_at(law, strain_at(law, TENSIONS))
    np.testing.assert_allclose(back, TENSIONS, rtol=1e-11, atol=1e-12)


def test_the_slope_is_the_derivative_and_rises_from_soft_to_ea():
    for t in TENSIONS[3:]:
        h = 1e-5 * t
        slope = 2.0 * h / (strain_of(t + h) - strain_of(t - h))
        assert modulus_at(LAW, float(t)) == pytest.approx(slope, rel=1e-7)
    moduli = modulus_at(LAW, TENSIONS)
    assert np.all(np.diff(moduli) > 0.0)
    assert moduli[0] == pytest.approx(1.0 / (1.0 / 6000.0 + 0.004 / 8.0))
    assert moduli[-1] == pytest.approx(6000.0, rel=1e-4)
    assert secant_at(LAW, 8.0) == pytest.approx(8.0 / strain_of(8.0))


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


def rope(creep=CREEP, uncertain=""):
    return parse_robot(ROPE % (creep, uncertain))


def tensions(model, angle, dt):
    """Tension of the rope while the winch turns by ``angle`` [rad], samples ``dt`` [s] apart."""
    stamps = 1 + np.round(1e9 * dt * np.arange(angle.size)).astype(np.int64)
    samples = Samples(stamps, angle[:, None], np.zeros((angle.size, 0)))
    return run(model, initial_state(model), samples)[1].values[:, model.layout.tension][:, 0]


@pytest.mark.parametrize("dt", [0.001, 0.1, 3.0])
def test_a_rope_that_is_pulled_and_held_relaxes(dt):
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


def test_a_flowing_rope_loses_its_tension_for_good():
    model = prepare(rope(f"flow_time: {FLOW:g}"))
    found = tensions(model, np.zeros(10_001), 0.01)
    np.testing.assert_allclose(found, PRELOAD * np.exp(-0.01 * np.arange(10_001) / FLOW), rtol=1e-9)


def test_a_slack_rope_recovers():
    """Pulled for long, let go for long: it is as long as before."""
    angle = np.concatenate([[0.0], np.full(3000, 1.0), np.full(6000, -1.5), np.zeros(6000)])
    found = tensions(prepare(rope()), angle, 0.01)
    assert found[5000] == 0.0
    at_once = PRELOAD * (1.0 + SHARE)
    assert found[9001] == pytest.approx(at_once, rel=0.02), "all delayed strain is gone"
    assert found[-1] == pytest.approx(PRELOAD, rel=0.02)
