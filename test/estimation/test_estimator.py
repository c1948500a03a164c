"""Properties of the estimator for every friction law; test/model/test_laws.py has physical laws."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.state import state_views

from cdrj_ros._core import Law
from cdrj_ros.estimation.estimator import Sample, Samples, initial_state, run, step
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import load_robot, parse_robot

PROTOTYPE = load_robot(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")
EPOCH_NS = 1_700_000_000_000_000_000

# Two motors, two joints, a cable between two winches, and tangents that vanish in reachable poses.
ROUTED = """
name: routed
motors: [{name: m}, {name: n, effort_sign: -1}]
joints:
  - {name: p, range: [-0.8, 0.8], effort_sign: -1}
  - {name: s, range: [0, 0.35], reference_angle: 0.175}
frames:
  - {name: arm, motion: revolute, joint: p, origin: [1, 0]}
  - {name: slide, parent: arm, motion: prismatic, joint: s, origin: [0.3, 0], direction: [-1, -1]}
friction: {mu_c: 0.12, mu_s: 0.2, stribeck_speed: 0.01, stribeck: capstan, viscous: 3}
cables:
  - name: a
    axial_stiffness: 5000
    preload: 20
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.02, position: [0, 0], turn: ccw}
      - {type: pulley, radius: 0.05, position: [0.5, 0.4], turn: cw}
      - {type: pulley, radius: 0.03, frame: arm, position: [0.1, -0.4], turn: ccw}
      - {type: winch, motor: n, winding: -1, radius: 0.02, frame: slide, position: [0.2, 0], turn: ccw}
  - name: b
    axial_stiffness: 5000
    preload: 5
    friction: {law: lugre}
    nodes:
      - {type: winch, motor: n, winding: 1, radius: 0.02, position: [0, -1], turn: cw}
      - {type: anchor, frame: slide, position: [0, -0.1]}
"""  # noqa: E501
ROUTED_MODEL = prepare(parse_robot(ROUTED))


def law_of(law):
    cables = tuple(replace(cable, law=law) for cable in PROTOTYPE.cables)
    robot = replace(PROTOTYPE, cables=cables)
    return prepare(robot)


def motion(model, size, seed=0):
    """A smooth motion within the ranges, with irregular and some repeated stamps."""
    generator = np.random.default_rng(seed)
    stamps = EPOCH_NS + np.cumsum(generator.choice([0, 300_000, 1_000_000, 1_700_000], size))
    time = (stamps - stamps[0]) * 1e-9
    joints = model.robot.joints
    joint = np.empty((size, len(joints)))
    for k, one in enumerate(joints):
        wave = np.sin((3.0 + k) * time) * np.cos((1.3 + k) * time)
        joint[:, k] = 0.5 * (one.lower + one.upper) + 0.45 * (one.upper - one.lower) * wave
    motor = np.stack([0.2 * np.sin((5 + k) * time) for k in range(len(model.robot.motors))], axis=1)
    if model.robot.name == "prototype":
        motor += 8.0 * np.sin(joint)
    return Samples(stamps, motor, joint)


MODELS = {law: law_of(law) for law in Law.__members__} | {"routed": ROUTED_MODEL}


@pytest.mark.parametrize("name", MODELS)
def test_a_run_in_any_pieces_gives_the_bits_of_step_by_step(name):
    model = MODELS[name]
    samples = motion(model, 800)
    state = initial_state(model)
    rows = []
    for k in range(800):
        state, estimate = step(model, state, samples.at(k))
        assert estimate.stamp_ns == state.stamp_ns == samples.stamp_ns[k]
        rows.append(estimate.values.copy())
    stepped = np.array(rows)
    assert np.ptp(stepped[:, model.layout.tension]) > 1.0
    for cuts in ((0, 800), (0, 1, 800), (0, 333, 333, 700, 800)):
        resumed, parts = initial_state(model), []
        for begin, end in pairwise(cuts):
            resumed, estimates = run(model, resumed, samples.part(slice(begin, end)))
            parts.append(estimates.values)
        assert np.concatenate(parts).tobytes() == stepped.tobytes()
        assert resumed.values.tobytes() == state.values.tobytes()
        assert resumed.stamp_ns == state.stamp_ns


def test_states_and_samples_are_never_changed_in_place():
    samples = motion(ROUTED_MODEL, 300)
    copies = [column.copy() for column in vars(samples).values()]
    state, _ = run(ROUTED_MODEL, initial_state(ROUTED_MODEL), samples.part(slice(0, 100)))
    kept = state.values.copy()
    first = run(ROUTED_MODEL, state, samples.part(slice(100, 300)))[1].values
    again = run(ROUTED_MODEL, state, samples.part(slice(100, 300)))[1].values
    assert first.tobytes() == again.tobytes(), "the same state may be used twice"
    _, one = step(ROUTED_MODEL, state, samples.at(100))
    _, other = step(ROUTED_MODEL, state, samples.at(100))
    assert one.values.tobytes() == other.values.tobytes()
    assert state.values.tobytes() == kept.tobytes()
    for column, copy in zip(vars(samples).values(), copies, strict=True):
        assert column.tobytes() == copy.tobytes()


def assert_refused(state):
    """A cable without a path is ``INVALID`` and has no tension; its state is unchanged."""
    # drum and pulley in the same place
    pose = np.array([0.1, 0.4 * np.sqrt(2.0)])
    at = Sample(state.stamp_ns + 1_000_000, np.full(2, 0.3), pose)
    after, estimate = step(ROUTED_MODEL, state, at)
    assert not estimate.solved
    of_first = np.array([name.startswith("a/") for name in ROUTED_MODEL.layout.elements])
    np.testing.assert_array_equal(estimate.status.astype(int) & INVALID != 0, of_first)
    assert np.all(np.isfinite(estimate.values))
    np.testing.assert_array_equal(estimate.tension[of_first], 0.0)
    kept, now = (
        state_views(ROUTED_MODEL.sizes, one.values).material[: of_first.sum()]
        for one in (state, after)
    )
    np.testing.assert_array_equal(now, kept)


def test_an_impossible_path_leaves_its_cables_history_unchanged():
    start = initial_state(ROUTED_MODEL)
    assert_refused(start)
    state, _ = run(ROUTED_MODEL, start, motion(ROUTED_MODEL, 300))
    assert_refused(state)


@settings(max_examples=150)
@given(
    st.sampled_from(sorted(MODELS)),
    st.lists(
        st.tuples(
            st.sampled_from([0, 1, 1_000, 1_000_000, 10**9, 10**13]),
            st.floats(-30.0, 30.0),
            st.floats(-30.0, 30.0),
            st.floats(0.0, 1.0),
            st.floats(0.0, 1.0),
        ),
        min_size=1,
        max_size=12,
    ),
)
def test_no_motion_within_the_ranges_ever_gives_a_nan(name, moves):
    model = MODELS[name]
    joints = model.robot.joints
    state = initial_state(model)
    stamp = EPOCH_NS
    for wait, first, second, share, other in moves:
        stamp += wait
        motor = np.array([first, second][: len(model.robot.motors)])
        shares = (share, other)[: len(joints)]
        joint = np.array(
            [j.lower + x * (j.upper - j.lower) for j, x in zip(joints, shares, strict=True)]
        )
        state, estimate = step(model, state, Sample(stamp, motor, joint))
        assert np.all(np.isfinite(state.values))
        assert np.all(np.isfinite(estimate.values))
        assert np.all(estimate.tension >= 0.0)
        status = estimate.status.astype(int)
        assert estimate.solved == (not np.any(status & INVALID))
        assert np.all(estimate.tension[status & INVALID > 0] == 0.0)
