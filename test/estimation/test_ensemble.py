"""The standard deviations match the actual errors of the estimate."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from support.places import ROBOT, ROBOTS, ROOT

from cdrj_ros.estimation.draws import Streams, draw_members
from cdrj_ros.estimation.ensemble import MEMBERS, Ensemble
from cdrj_ros.estimation.estimator import (
    ALL_SEEN_OVER_TIME,
    Sample,
    Samples,
    initial_state,
    run,
    step,
)
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.robot.parameters import find_number
from cdrj_ros.robot.reader import parse_robot

RATE = 100.0
RUNS = 200
WATCHED = 1000
"""Number of samples in a run of the estimator."""
EVERY = 20
"""Only every n-th sample is evaluated."""
SECOND = round(RATE / EVERY)
"""Number of evaluated samples per second."""


def _path(model, bag):
    """A smooth motion of motor and joint, used as the true motion."""
    recording = read_inputs(str(ROOT / "bags" / bag), Topics(), model)
    samples = condition_recording(model, recording).segments[0]
    seconds = (samples.stamp_ns - samples.stamp_ns[0]) * 1e-9
    time = np.arange(0.0, seconds[-1], 1.0 / RATE)
    angles = [
        gaussian_filter1d(np.interp(time, seconds, values[:, 0]), 2.0)[:, None]
        for values in (samples.motor_angle, samples.joint_angle)
    ]
    return Samples(1_000_000_000 + np.round(time * 1e9).astype(np.int64), *angles)


def _read(model, path, part, generator):
    """Readings of encoders with the robot's resolution on a part of the path."""
    columns = []
    for axis, angle in zip(model.robot.axes, (path.motor_angle, path.joint_angle), strict=True):
        count, begin = axis.sensor.resolution, generator.random()
        columns.append((np.round(angle[part] / count + begin) - begin) * count)
    return Samples(path.stamp_ns[part], columns[0], columns[1])


def _hits(preload, bag, runs, seed):
    """Whether truth lies within two standard deviations, shape (runs, times, columns)."""
    generator = np.random.default_rng(seed)
    model = load_model(ROBOT, preload)
    path = _path(model, bag)
    known = model.robot.uncertainty
    drawn = draw_members(model.robot, known, runs, Streams(seed), lambda one: prepare(one, False))
    truths = [one or model for one in drawn]
    generator.shuffle(truths)
    ensembles = [Ensemble(model, seed=k) for k in range(4)]
    hits = []
    for k, truth in enumerate(truths):
        begin = int(generator.integers(int(12 * RATE), path.stamp_ns.size - WATCHED))
        until = slice(0, begin + WATCHED)
        so_far = Samples(path.stamp_ns[until], path.motor_angle[until], path.joint_angle[until])
        _, true = run(truth, initial_state(truth), so_far)
        ensemble = ensembles[k % len(ensembles)]
        ensemble.reset()
        readings = _read(model, path, slice(begin, begin + WATCHED), generator)
        estimates = ensemble.follow(readings, run(model, initial_state(model), readings)[1])
        columns = ensemble.columns
        error = np.abs(estimates.values[:, columns] - true.values[begin:, columns])
        hits.append((error <= 2.0 * estimates.stddev)[::EVERY])
    return np.array(hits)


def test_two_standard_deviations_cover_the_expected_share():
    # 200 robots have parameters drawn from the robot file's covariance.  Each estimate starts in
    # the middle of a motion, from encoder readings, without knowledge of the friction history.
    hits = np.concatenate(
        [
            _hits("36.85,26.26", "prototype_preload_36_26", RUNS // 2, 1),
            _hits("23.52,16.66", "prototype_preload_23_6", RUNS // 2, 2),
        ]
    )
    assert len(hits) == RUNS
    elements = len(load_model(ROBOT).layout.elements)
    each = hits[:, :, :elements].mean(axis=(0, 1))
    print(  # noqa: T201 for docs/estimation.md
        f"\n{hits.mean():.1%} of all, {each.mean():.1%} of all tensions; elements from "
        f"{each.min():.1%} to {each.max():.1%}, in the first second from "
        f"{hits[:, :SECOND, :elements].mean(axis=(0, 1)).min():.1%}"
    )
    assert 0.92 <= hits.mean() <= 0.98
    assert each.min() >= 0.85
    assert each.max() <= 0.995


@pytest.fixture(scope="module")
def path(model):
    return _path(model, "prototype_preload_36_26")


@pytest.mark.parametrize("seen", [True, False])
def test_in_one_call_estimate_and_spread_are_the_same(model, path, seen):
    one, two = Ensemble(model), Ensemble(model)
    state_one = state_two = initial_state(model)
    with_a_gap = [*range(200), *range(2000, 2100)]
    unseen = ALL_SEEN_OVER_TIME if seen else np.full((len(with_a_gap), 2, 2), 1e-3)
    angles = path.motor_angle[with_a_gap], path.joint_angle[with_a_gap]
    samples = Samples(path.stamp_ns[with_a_gap], *angles, unseen)
    expected = two.follow(samples, run(model, state_two, samples)[1])
    for k in range(len(with_a_gap)):
        read = samples.at(k)
        state_one, estimate = one.step(state_one, read)
        state_two, alone = step(model, state_two, read)
        assert estimate.stddev.tobytes() == expected.stddev[k].tobytes()
        assert state_one.values.tobytes() == state_two.values.tobytes()
        assert estimate.values.tobytes() == alone.values.tobytes() == expected.values[k].tobytes()
        assert (estimate.solved, estimate.stamp_ns) == (alone.solved, alone.stamp_ns)
    assert one.memory()["members"].tobytes() == two.memory()["members"].tobytes()


ONE_STRAND = """
name: strand
motors: [{{name: m, noise: {noise}}}]
joints: []
cables:
  - name: c
    axial_stiffness: 1000
    preload: 50
    nodes: [{{type: winch, motor: m, radius: 0.01, winding: 1}}, {{type: anchor}}]
    spans: [2.0]
uncertainty: {{others: exact, parameters: [cables.c.preload, cables.c.axial_stiffness],
  stddev: [{preload}, {ea}],
  correlation: [[1, {rho}], [{rho}, 1]]}}
"""


@pytest.mark.parametrize(
    ("preload", "ea", "rho", "expected"),
    [
        (2.0, 0.0, 0.0, 2.0),  # t = t0 in the reference pose
        (0.0, 10.0, 0.0, 0.0),  # where it does not depend on the stiffness
        (2.0, 10.0, 0.5, 2.0),
    ],
)
def test_linear_dependence_gives_the_exact_spread(preload, ea, rho, expected):
    text = ONE_STRAND.format(noise=0.0, preload=preload, ea=ea, rho=rho)
    model = prepare(parse_robot(text))
    ensemble = Ensemble(model)
    sample = Sample(1, np.zeros(1), np.zeros(0))
    stddev = ensemble.step(initial_state(model), sample)[1].stddev
    assert stddev[0] == pytest.approx(expected, abs=1e-9)
    assert stddev[1] == pytest.approx(0.01 * expected, abs=1e-9)  # the motor's effort


def test_noise_of_an_encoder_becomes_noise_of_the_tension():
    model = prepare(parse_robot(ONE_STRAND.format(noise=1e-3, preload=0.0, ea=0.0, rho=0.0)))
    ensemble = Ensemble(model)
    state = initial_state(model)
    spreads = []
    for k in range(1, 2000):
        sample = Sample(k * 1_000_000, np.zeros(1), np.zeros(0))
        state, estimate = ensemble.step(state, sample)
        spreads.append(estimate.stddev[0])
    # dt / dphi = EA / l * r at a strain of 5 %
    expected = 1e-3 * 1000.0 / (2.0 / 1.05) * 0.01
    assert np.mean(spreads) == pytest.approx(expected, rel=0.1)


def test_an_impossible_draw_is_replaced_and_not_reduced():
    """The idlers of the wrist are closer together than the default accuracy of their positions."""
    model = load_model(str(ROBOTS / "wrist.yaml"))
    known = model.robot.uncertainty
    drawn = draw_members(model.robot, known, MEMBERS, Streams(0), lambda one: prepare(one, False))
    robots = [one.robot for one in drawn if one is not None]
    stddev = np.sqrt(np.diag(known.covariance))
    for k, path in enumerate(known.parameters):
        if ".position." in path:
            nominal = find_number(dict(model.robot.document), path).value
            drawn = np.array([find_number(dict(one.document), path).value for one in robots])
            assert len(set(drawn)) == MEMBERS
            assert 0.5 < np.std(drawn - nominal) / stddev[k] < 1.5
