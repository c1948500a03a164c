"""Laws of the learned corrections, (R1) to (R3), against their equations in NumPy."""

import numpy as np
import pytest
from support.places import ROBOTS
from support.refusal import refusal

from cdrj_ros.estimation.ensemble import Ensemble, stddev_columns
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.estimation.state_file import read_state, write_state
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.packing import SLACK, channel_columns
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

TEXT = (ROBOTS / "davinci_jaw.yaml").read_text(encoding="utf-8")
RANGES = np.array([[-0.05, 0.2], [0.0, 1.05], [0.16, 1.24]])
BOUND = {"effort/spindle": 0.008, "tension/b/3": 0.6}
STDDEV = 0.001
GENERATOR = np.random.default_rng(3)
WEIGHTS = {"effort/spindle": GENERATOR.normal(0.0, 0.004, (15, 4)),
           "tension/b/3": GENERATOR.normal(0.0, 0.3, (15, 4))}  # fmt: skip


def block(channel, **other):
    load = RANGES[0] if channel.startswith("effort") else np.array([1.0, 20.0])
    entry = {
        "output": channel, "bound": BOUND[channel], "stddev": STDDEV,
        "inputs": {
            channel: load.tolist(), "spindle": RANGES[1].tolist(), "jaw": RANGES[2].tolist(),
        },
        "weights": WEIGHTS[channel].tolist(),
    }  # fmt: skip
    return f"  - {entry | other}\n"


def model_of(*blocks, text=TEXT):
    return prepare(parse_robot(text + ("\nresidual:\n" if blocks else "") + "".join(blocks)))


PLAIN, BOTH = model_of(), model_of(*map(block, BOUND))


def motion(count=3000):
    """A jaw that follows the spindle, with rests, and jumps out of the range seen."""
    time = np.arange(count) * 2e-3
    spindle = 0.5 + 0.4 * np.round(np.sin(2.0 * time) * 60.0) / 60.0
    jaw = 1.25 - spindle + 0.1 * np.sin(3.1 * time)
    spindle[1000:1003] += 1.3
    spindle[1500:1700] += np.linspace(0.0, 0.5, 200)
    stamps = 10**9 + np.arange(count, dtype=np.int64) * 2_000_000
    return Samples(stamps, spindle[:, None].copy(), jaw[:, None].copy())


MOTION = motion()
TABLE = np.hstack([MOTION.motor_angle, MOTION.joint_angle])


def estimates_of(model, samples=MOTION):
    return run(model, initial_state(model), samples)[1]


def expected(output, load, ranges):
    """(R1) to (R3), sample by sample: the correction, and its trust."""
    places = (np.column_stack([load, TABLE]) - ranges.mean(axis=1)) / (np.ptp(ranges, axis=1) / 2.0)
    limit, before = np.array([0.01, 0.04, 0.16]), places[0]
    stops, rest, way = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    found = np.empty((2, len(load)))
    for k, place in enumerate(places):
        moved, before = place - before, place
        stops = np.clip(stops + moved[:, None], -limit, limit)
        rest = np.where(moved != 0.0, 0.0, np.minimum(rest + 2e-3, 0.2))
        way = np.where(moved != 0.0, np.sign(moved), way)
        rows = np.column_stack([place, stops / limit, way * rest / 0.2]).ravel()
        value = float(rows @ WEIGHTS[output] @ np.array([1.0, *place]))
        trust = min(max(1.0 - (np.abs(place).max() - 1.0) / 0.5, 0.0), 1.0)
        found[:, k] = trust * min(max(value, -BOUND[output]), BOUND[output]), trust
    return found[0], found[1]


def test_the_correction_is_that_of_its_equations_and_no_other_output_changes():
    """Within its bound, none where nothing was seen, and a jump only fills the stop operators."""
    plain, both, columns = estimates_of(PLAIN), estimates_of(BOTH), channel_columns(PLAIN.layout)
    changed = [columns[name] for name in BOUND]
    for k, name in enumerate(BOUND):
        load = plain.values[:, columns[name]]
        ranges = RANGES if k == 0 else np.vstack([[1.0, 20.0], RANGES[1:]])
        correction, trust = expected(name, load, ranges)
        np.testing.assert_allclose(both.values[:, BOTH.layout.trust][:, k], trust, atol=1e-12)
        wanted = load + correction if k == 0 else np.maximum(load + correction, 0.0)
        np.testing.assert_allclose(both.values[:, columns[name]], wanted, atol=1e-9)
        assert np.abs(correction).max() == BOUND[name]
        assert np.any(trust == 0.0)
        assert np.any((trust > 0.0) & (trust < 1.0))
    others = np.setdiff1d(np.arange(PLAIN.layout.size), changed)
    others = others[others != PLAIN.layout.status.start + 2]  # of the corrected element
    np.testing.assert_array_equal(both.values[:, others], plain.values[:, others])


def test_the_status_of_an_element_is_that_of_its_corrected_tension():
    tension = channel_columns(PLAIN.layout)["tension/b/3"]
    high = float(estimates_of(PLAIN).values[:, tension].max()) - 0.1
    slack = TEXT.replace("    preload: 0", f"    slack_tension: {high}\n    preload: 0")
    found = estimates_of(model_of(block("tension/b/3"), text=slack)).values
    flags = found[:, PLAIN.layout.status.start + 2].astype(int) & SLACK
    np.testing.assert_array_equal(flags != 0, found[:, tension] <= high)
    assert 0 < np.count_nonzero(flags) < len(flags)


def test_a_node_and_its_next_start_give_what_the_whole_recording_gives(tmp_path):
    """The state, and the file in which a node keeps it, hold all memory of a correction."""
    found = estimates_of(BOTH)
    first, second = LiveEstimator(BOTH), LiveEstimator(BOTH)
    for k in range(400):
        assert_same(first.take(MOTION.at(k)), found, k)
    assert write_state(first, tmp_path / "state")
    assert read_state(second, tmp_path / "state").startswith("continues")
    for k in range(400, 800):
        assert_same(second.take(MOTION.at(k)), found, k)


def assert_same(estimate, found, k):
    np.testing.assert_array_equal(estimate.tension, found.tension[k])
    np.testing.assert_array_equal(estimate.motor_effort, found.motor_effort[k])


def test_the_band_is_that_of_the_correction_where_it_applies_and_of_the_model_elsewhere():
    """(U14); the tensions, by which units of axes are judged, are those of the model."""
    corrected = model_of(block("effort/spindle"))
    column = (
        stddev_columns(PLAIN.layout).tolist().index(channel_columns(PLAIN.layout)["effort/spindle"])
    )
    plain, both = (
        Ensemble(model).follow(MOTION, estimates_of(model)) for model in (PLAIN, corrected)
    )
    trust = both.values[:, corrected.layout.trust.start]
    known = dict(PLAIN.robot.uncertainty.model_error)["effort/spindle"]
    spread = plain.stddev[:, column] ** 2 - known**2
    left = trust * STDDEV**2 + (1.0 - trust) * known**2
    np.testing.assert_allclose(both.stddev[:, column] ** 2, spread + left, rtol=1e-9)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            block("effort/spindle", output="effort/thumb"),
            "residual[0].output 'effort/thumb' is no",
        ),
        (2 * block("effort/spindle"), "residual[1].output 'effort/spindle' is taken already"),
        (
            block("effort/spindle", inputs={"effort/spindle": [0, 1], "wrist": [0, 1]}),
            "residual[0].inputs must be effort/spindle, then some of jaw, spindle; got",
        ),
        (
            block("effort/spindle", inputs={"effort/spindle": [1, 1]}),
            "residual[0].inputs.effort/spindle must increase by 1e-09",
        ),
        (
            block("effort/spindle", weights=[[1, 2]] * 6),
            "residual[0].weights must have 15 rows of 4",
        ),
        (block("effort/spindle", bound=-1), "residual[0].bound must be at least 0"),
    ],
)
def test_a_wrong_entry_is_refused_by_name(text, complaint):
    assert complaint in refusal(model_of, text)


def test_a_joint_without_encoder_excludes_corrections():
    text = TEXT.replace("  - name: jaw", "  - name: jaw\n    measured: false")
    with pytest.raises(RobotFileError, match="residual is not possible"):
        model_of(block("effort/spindle"), text=text)


def test_a_correction_is_one_of_all_cables():
    every = np.ones(len(BOTH.robot.cables), np.bool_)
    with pytest.raises(ValueError, match="of all cables"):
        run(BOTH, initial_state(BOTH), MOTION, chosen=~every)
    found = run(BOTH, initial_state(BOTH), MOTION, chosen=every)[1]
    np.testing.assert_array_equal(found.values, estimates_of(BOTH).values)
