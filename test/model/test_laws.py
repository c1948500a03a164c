"""Properties that hold for all motions: dissipation, bounds, symmetry, convergence, rest."""

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros._core import Law
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.model.prepared import prepare

ENCODERS = 2 * np.pi / 81_920, 2 * np.pi / 16_384
"""Steps of motor and joint encoder [rad]."""
WITH_FRICTION = [law for law in Law.__members__ if law != "none"]


def follow(joint):
    """Motor angle [rad] that compensates both strands and the arc of pulley 6."""
    wrap_by_joint = np.radians(78.5 - 0.6) / np.radians(80.0)
    return np.asarray((0.12 * np.sin(joint) - 0.0045 * wrap_by_joint * joint) / 0.015)


def estimated(model, samples):
    return run(model, initial_state(model), samples)[1]


def cyclic(drive, cycles=3.0, period=4000, step_s=1e-3, lead=np.pi / 2):
    """A steady cycle of the joint and a motor that leads it by a phase [rad], as under a load."""
    phase = 2 * np.pi * np.arange(round(cycles * period) + 1) / period
    joint = 0.6 * np.sin(phase)
    motor = follow(joint) + 0.12 * np.sin(phase + lead)
    return drive(np.arange(phase.size) * step_s, motor, joint)


def erratic(drive, seed, size=12_000):
    """A taut, smooth, random motion with encoder counts."""
    generator = np.random.default_rng(seed)
    time = np.arange(size) * 1e-3
    frequency, phase = generator.uniform(0.05, 1.0, (2, 10)), generator.uniform(0, 7, (2, 10))
    weight = generator.normal(size=(2, 10)) / np.sqrt(5.0)
    waves = np.sin(2 * np.pi * time[:, None, None] * frequency + phase)
    first, second = np.sum(waves * weight, axis=2).T
    joint = np.clip(0.3 * first, -0.69, 0.69)
    motor = follow(joint) + 0.05 * second
    return drive(
        time,
        np.round(motor / ENCODERS[0]) * ENCODERS[0],
        np.round(joint / ENCODERS[1]) * ENCODERS[1],
    )


@pytest.mark.parametrize("law", WITH_FRICTION)
@pytest.mark.parametrize("seed", range(3))
def test_no_pulley_ever_returns_more_than_its_bristles_have_stored(law, seed, variant, drive):
    model = prepare(variant(law))
    samples = erratic(drive, 10 + seed)
    estimates = estimated(model, samples)
    layout = model.layout
    slip = estimates.values[:, layout.slip_speed] * 1e-3
    force = estimates.values[:, layout.friction]
    stiffness = 1e9 if law in ("euler", "steady") else 1e6
    lost = force[1:] * slip[1:] - np.diff(force**2 / (2.0 * stiffness), axis=0)
    # implicit in the slip: the force at a sample's end times its slip
    assert lost.min() >= -1e-9
    assert lost.sum() > 0.01


@pytest.mark.parametrize("law", Law.__members__)
def test_a_mirrored_motion_gives_the_mirrored_loop(law, variant, drive):
    model = prepare(variant(law, preloads=(30.0, 30.0)))
    samples = erratic(drive, 20)
    other = replace(samples, motor_angle=-samples.motor_angle, joint_angle=-samples.joint_angle)
    layout = model.layout
    one, two = estimated(model, samples).values, estimated(model, other).values
    tension, mirrored = one[:, layout.tension], two[:, layout.tension]
    np.testing.assert_allclose(mirrored[:, 8:], tension[:, :8], atol=2e-5)
    np.testing.assert_allclose(mirrored[:, :8], tension[:, 8:], atol=2e-5)
    effort = slice(layout.motor_effort.start, layout.joint_effort.stop)
    np.testing.assert_allclose(two[:, effort], -one[:, effort], atol=1e-6)


@pytest.mark.parametrize("law", Law.__members__)
def test_the_error_shrinks_when_the_sample_period_is_halved(law, variant, drive):
    model = prepare(variant(law, mu_s=0.15))
    wanted = None
    errors = []
    for every in (1, 16, 32, 64):
        period = 6400 // every
        samples = cyclic(drive, 1.6, period, 1e-3 * every)
        values = estimated(model, samples).values[:: 64 // every, :16]
        if wanted is None:
            wanted = values
        else:
            errors.append(np.abs(values - wanted).mean())
    fine, middle, coarse = errors
    assert 0.0 < fine < 0.1
    for finer, coarser in ((fine, middle), (middle, coarse)):
        assert coarser / finer > 1.6


def roughness(series):
    """Second differences over first differences of columns: small where smooth, 2 for a saw."""
    first = np.abs(np.diff(series, axis=0)).sum(axis=0)
    second = np.abs(np.diff(series, 2, axis=0)).sum(axis=0)
    return float((second / first).max())


STRONG = {"mu_c": 0.1, "mu_s": 0.3, "rho": 0.6, "stribeck_speed": 0.02}
CHATTER = {
    "table-two": {},
    "table-two-with-sigma1": {"bristle_damping": 1000.0},
    "strong": STRONG,
    "strong-with-sigma1": {**STRONG, "bristle_damping": 1000.0},
}


@pytest.mark.parametrize("law", ["steady", "lugre", "elastoplastic"])
@pytest.mark.parametrize(
    ("friction", "rate"),
    # sigma1 beyond sigma0 times the sample time chatters: see the robot file's bristle_damping
    [*((name, 1000) for name in CHATTER), *((n, 5000) for n in CHATTER if "strong-" not in n)],
)
def test_static_friction_does_not_chatter(law, rate, friction, variant, drive):
    model = prepare(variant(law, **CHATTER[friction]))
    samples = cyclic(drive, 1.5, 4 * rate, 1.0 / rate)
    estimates = estimated(model, samples)
    assert np.abs(estimates.values[:, model.layout.slip_speed]).max() > 0.04, "through v_s"
    tension = estimates.values[:, model.layout.tension]
    assert roughness(tension) < 0.4
