"""step() and run(): one estimator, the same bits, no state changed in place, never a NaN."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Sample, Samples, initial_state, run, step
from cdrj_ros.model.mechanism import INVALID, OVERLOAD, SLACK
from cdrj_ros.model.plan import Model, prepare
from cdrj_ros.model.robot_file import load_robot, parse_robot

FILE = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"
MODEL = prepare(load_robot(FILE))


def _motion(n: int = 3000, drift: float = 0.0) -> Samples:
    """A sine with encoder counts, stamps unevenly spaced."""
    generator = np.random.default_rng(1)
    stamps = 10**9 + np.cumsum(generator.integers(300_000, 1_700_000, n))
    time = (stamps - stamps[0]) * 1e-9
    joint = np.round(0.6 * np.sin(2.0 * time) / 3.83e-4) * 3.83e-4
    motor = 0.12 * np.sin(0.6 * np.sin(2.0 * time)) / 0.015 + drift * time
    motor = np.round(motor / 7.67e-5) * 7.67e-5
    return Samples(stamps, motor[:, None], joint[:, None])


def _sample(samples: Samples, k: int) -> Sample:
    return Sample(int(samples.stamp_ns[k]), samples.motor_angle[k], samples.joint_angle[k])


def test_run_equals_step_by_step_bit_for_bit() -> None:
    samples = _motion()
    last, estimates = run(MODEL, initial_state(MODEL), samples)
    state = initial_state(MODEL)
    for k in range(samples.stamp_ns.size):
        state, estimate = step(MODEL, state, _sample(samples, k))
        assert np.array_equal(estimate.values, estimates.values[k])
    assert np.array_equal(state.values, last.values)
    assert state.stamp_ns == last.stamp_ns


def test_a_run_may_be_cut_in_two() -> None:
    samples = _motion()
    _, whole = run(MODEL, initial_state(MODEL), samples)
    parts = [
        Samples(*(a[piece] for a in (samples.stamp_ns, samples.motor_angle, samples.joint_angle)))
        for piece in (slice(0, 1234), slice(1234, None))
    ]
    state, first = run(MODEL, initial_state(MODEL), parts[0])
    _, second = run(MODEL, state, parts[1])
    assert np.array_equal(np.concatenate([first.values, second.values]), whole.values)


def test_no_state_is_changed_in_place() -> None:
    samples = _motion(200)
    state = initial_state(MODEL)
    history = []
    for k in range(200):
        history.append((state, state.values.copy()))
        state, _ = step(MODEL, state, _sample(samples, k))
    run(MODEL, history[100][0], _motion(50))
    assert all(np.array_equal(state.values, copy) for state, copy in history)


def test_the_first_sample_in_the_reference_pose_has_the_preload_everywhere() -> None:
    _, estimate = step(MODEL, initial_state(MODEL), Sample(1, np.zeros(1), np.zeros(1)))
    assert estimate.tension[:8] == pytest.approx(36.85, rel=1e-12)
    assert estimate.tension[8:] == pytest.approx(26.26, rel=1e-12)
    assert estimate.solved


def test_slack_and_overload_are_said_and_tension_is_never_negative() -> None:
    samples = _motion(4000, drift=0.5)
    _, estimates = run(MODEL, initial_state(MODEL), samples)
    layout = MODEL.layout
    tension = estimates.values[:, layout.tension]
    status = estimates.values[:, layout.status].astype(int)
    assert tension.min() == 0.0
    assert np.array_equal(tension == 0.0, (status & SLACK) != 0)
    assert np.array_equal(tension > 120.0, (status & OVERLOAD) != 0)
    assert (status & SLACK).any()
    assert (status & OVERLOAD).any()
    assert not (status & INVALID).any()


def test_a_cable_comes_back_from_slack() -> None:
    angles = np.concatenate([np.linspace(0, -1.0, 500), np.linspace(-1.0, 0.0, 500)])
    stamps = np.arange(1, 1001, dtype=np.int64) * 1_000_000
    samples = Samples(stamps, angles[:, None], np.zeros((1000, 1)))
    _, estimates = run(MODEL, initial_state(MODEL), samples)
    upper = estimates.values[:, MODEL.layout.tension][:, :8]
    assert upper[499].max() == 0.0
    assert upper[-1] == pytest.approx(36.85, rel=0.35)
    assert upper[-1].min() > 0.0


def test_huge_jumps_and_long_rests_are_solved() -> None:
    generator = np.random.default_rng(2)
    n = 300
    stamps = np.cumsum(generator.choice([1, 1000, 10**6, 10**9], n)).astype(np.int64)
    joint = generator.uniform(-0.69, 0.69, n)
    motor = 0.12 * np.sin(joint) / 0.015 + generator.uniform(-0.3, 0.3, n)
    _, estimates = run(MODEL, initial_state(MODEL), Samples(stamps, motor[:, None], joint[:, None]))
    assert np.all(np.isfinite(estimates.values))
    assert not (estimates.values[:, MODEL.layout.status].astype(int) & INVALID).any()


@pytest.mark.parametrize("law", ["none", "euler", "steady", "lugre", "elastoplastic"])
def test_every_law_is_solved_at_every_sample_and_keeps_its_bounds(law: str) -> None:
    text = FILE.read_text().replace("law: elastoplastic", f"law: {law}")
    model = prepare(parse_robot(text))
    samples = _motion()
    _, estimates = run(model, initial_state(model), samples)
    layout = model.layout
    assert estimates.values[:, layout.residual].max() <= 1e-8 + 1e-14 * 6284
    tension = estimates.values[:, layout.tension]
    for first in (0, 8):
        before, after = tension[:, first : first + 7], tension[:, first + 1 : first + 8]
        ratio = np.minimum(before, after) / np.maximum(before, after)
        if law == "none":
            assert ratio.min() > 1.0 - 1e-8
        else:
            assert ratio.min() > 0.5
            assert ratio.min() < 0.97


def _scissors() -> Model:
    """Two joints; pulley and anchor collide only where both are far out."""
    return prepare(
        parse_robot("""
name: scissors
motors: [{name: m}]
joints: [{name: p, range: [0, 1]}, {name: q, range: [0, 1]}]
frames:
  - {name: a, motion: prismatic, joint: p}
  - {name: b, motion: prismatic, joint: q, direction: [-1, 0], origin: [2.0, 0]}
cables:
  - name: c
    axial_stiffness: 1000
    preload: 5
    nodes:
      - {type: winch, motor: m, radius: 0.02, winding: 1, position: [0, -1.0], turn: ccw}
      - {type: pulley, radius: 0.01, position: [0, 0.0], frame: a, turn: cw}
      - {type: anchor, position: [0.015, 0], frame: b}
""")
    )


def test_an_impossible_pose_changes_nothing_and_is_no_number() -> None:
    model = _scissors()
    zero = np.zeros(1)
    state, good = step(model, initial_state(model), Sample(1, zero, np.array([0.2, 0.2])))
    after, bad = step(model, state, Sample(2, zero, np.array([1.0 + 0.01, 1.0])))
    assert not bad.solved
    assert np.array_equal(after.values, state.values)
    assert np.all(bad.status.astype(int) & INVALID)
    assert np.all(np.isfinite(bad.values))
    _, again = step(model, after, Sample(3, zero, np.array([0.2, 0.2])))
    assert again.tension == pytest.approx(good.tension)
