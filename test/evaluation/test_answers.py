"""Prediction of the estimates and counting of the answers.  Does not depend on ROS."""

from dataclasses import replace

import numpy as np
import pytest
from support.places import ROBOT, SAMPLE

from cdrj_ros.estimation.conditioner import Conditioned
from cdrj_ros.estimation.ensemble import stddev_columns
from cdrj_ros.estimation.estimator import Sample, initial_state, run, step
from cdrj_ros.evaluation.answers import AnotherRobotError, Answers, Run, Tally
from cdrj_ros.evaluation.inputs import read_inputs
from cdrj_ros.evaluation.metrics import errors_of
from cdrj_ros.evaluation.replayed import (
    NodeSettings,
    Outcome,
    preload_difference,
    require_every_sample,
)
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import EstimateEncoder, Template
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics

MS = 1_000_000
FIRST_NS = 1_000 * MS


class Bench:
    """A run with its inputs and an estimator whose answers the test determines."""

    def __init__(self, model, conditioning="wait"):
        self.model = model
        self.run = Run(model, conditioning)
        layout = model.layout
        self._motor = Template(JOINT_STATE, layout.motors, ("position",))
        self._joint = Template(JOINT_STATE, layout.joints, ("position",))
        self._ask = self.run.asker("motors"), self.run.asker("joints")
        self._encoder = EstimateEncoder(layout)
        self._hear = [self.run.listener(k) for k in range(3)]
        at = Sample(FIRST_NS, np.zeros(len(layout.motors)), np.zeros(len(layout.joints)))
        self._estimate = step(model, initial_state(model), at)[1]

    def send(self, *numbers, motors=True, joints=True):
        for number in numbers:
            stamp = FIRST_NS + number * MS
            if motors:
                self._ask[0](self._motor.encode(stamp, position=0.0), stamp)
            if joints:
                self._ask[1](self._joint.encode(stamp, position=0.0), stamp)

    def answer(self, *numbers, topics=(0, 1, 2)):
        for number in numbers:
            estimate = replace(self._estimate, stamp_ns=FIRST_NS + number * MS)
            messages = self._encoder.encode(estimate)
            for topic in topics:
                self._hear[topic](messages[topic])


@pytest.fixture(scope="module")
def model():
    return load_model(ROBOT)


@pytest.fixture
def bench(model):
    return Bench(model)


def test_an_estimate_is_expected_once_motors_and_joints_have_been_sent(bench):
    bench.send(0, 1, 2, joints=False)
    assert bench.run.tally() == Tally(sent=3)
    bench.send(0, 1, motors=False)
    assert bench.run.tally() == Tally(sent=5, expected=2)
    assert bench.run.under_way == 2


def test_an_answer_missing_for_too_long_is_lost_unless_it_comes_later(bench):
    bench.send(0, 1)
    now = bench.run.received_s + 1e9
    assert bench.run.give_up_stalled(0.0) == 0
    assert bench.run.give_up_stalled(now) == 2
    assert bench.run.tally() == Tally(sent=4, expected=2, lost=2)
    bench.answer(1)
    assert bench.run.tally() == Tally(sent=4, expected=2, received=1, lost=1)


def test_an_answer_without_an_input_is_counted_as_strange(bench):
    bench.send(0, 1)
    bench.answer(77)
    assert bench.run.tally().strange == 3
    assert bench.run.tally().received == 0


def test_a_refused_reading_is_not_waited_for(bench):
    bench.send(0, 1, 1, 2)
    assert bench.run.tally().expected == 3
    assert bench.run.finish().conditioned.refused["repeated"] == 2


def test_an_estimator_of_another_robot_is_noticed(bench):
    layout = bench.model.layout
    names = tuple(name.replace("upper", "left") for name in layout.elements)
    encoder = EstimateEncoder(replace(layout, elements=names))
    bench.send(0)
    bench.run.listener(0)(encoder.encode(replace(bench._estimate, stamp_ns=FIRST_NS)).tensions)
    assert isinstance(bench.run.trouble, AnotherRobotError)
    assert "tensions are of left/1" in str(bench.run.trouble)
    assert "expected upper/1" in str(bench.run.trouble)


def test_values_come_back_as_they_were_sent(bench):
    count, said = 50, stddev_columns(bench.model.layout).size
    bench._estimate = replace(bench._estimate, stddev=1.0 + np.arange(said))
    bench._encoder = EstimateEncoder(bench.model.layout, uncertain=True)
    for k in range(count):
        bench.send(k)
        bench.answer(k)
    answers = bench.run.finish()
    layout, sent = bench.model.layout, bench._estimate.values
    answered = ("tension", "force_x", "force_y", "force_z", "magnitude", "friction", "slip_speed",
                "motor_effort", "joint_effort")  # fmt: skip
    places = np.concatenate([np.arange(layout.size)[getattr(layout, name)] for name in answered])
    expected = np.full(layout.size, np.nan)
    expected[places] = sent[places]
    np.testing.assert_array_equal(answers.estimates.values, np.tile(expected, (count, 1)))
    assert np.ptp(expected[layout.magnitude]) > 1.0
    stddev = answers.estimates.stddev
    told = len(layout.elements) + len(layout.pulleys)  # efforts are published without
    assert np.array_equal(stddev[:, :told], np.tile(1.0 + np.arange(told), (count, 1)))
    assert np.isnan(stddev[:, told:]).all()
    assert np.all(answers.latency_s >= 0)


@pytest.mark.parametrize("off", [0.0, 0.25])
def test_passes_are_counted_and_their_difference_is_noted(model, off):
    outcome = Outcome(model)
    for difference in (0.0, off):
        bench = Bench(model)
        values = bench._estimate.values + difference
        bench._estimate = replace(bench._estimate, values=values)
        bench.send(*range(5))
        bench.answer(*range(5))
        outcome.add(bench.run.finish(), whole=True)
    assert (outcome.passes, outcome.whole_passes) == (2, 2)
    assert outcome.difference == pytest.approx(off)
    assert outcome.answers.estimates.stamp_ns.size == 5
    assert outcome.tally.received == 10
    assert ["should be identical" in note for note in outcome.notes()] == [True] * (off > 0.0)


def test_an_estimate_that_was_predicted_is_expected_once(model):
    """The joint is read at every fifth stamp; what was predicted between is computed again."""
    bench = Bench(model, "predict")
    for number in range(1, 31):
        bench.send(number, joints=number % 5 == 0)
    bench.answer(*range(5, 31))
    assert bench.run.tally() == Tally(36, 26, 26, 0, 0)


def test_what_is_known_of_standard_deviations_counts_for_the_coverage(model, recorded):
    """As from a node that runs without them."""
    samples, layout = recorded(model, 100), model.layout
    estimates = run(model, initial_state(model), samples)[1]
    count = samples.stamp_ns.size
    stddev = np.full((count, stddev_columns(layout).size), 0.05)
    stddev[: count // 2, :16] = np.inf
    stddev[:, -1] = np.nan
    conditioned = Conditioned((samples,), {}, 0, 0, 0)
    answers = Answers(Tally(), conditioned, replace(estimates, stddev=stddev), np.empty(0))
    outcome = Outcome(model, answers=answers)
    recording = read_inputs(str(SAMPLE), Topics(), model)
    errors = errors_of([outcome.comparison("bag", recording)]).pooled
    half, whole = errors["tension/upper/8"].coverage, errors["nodal_force/upper/8"].coverage
    assert 0.0 < half < 1.0
    assert 0.0 < whole < 1.0
    stddev[: count // 2, :16] = 0.05
    all_known = errors_of([outcome.comparison("bag", recording)]).pooled["tension/upper/8"]
    assert all_known.coverage == pytest.approx(half, abs=0.1)
    assert errors["effort/elbow"].coverage is None


def test_preloads_that_differ_are_named_with_both_values_and_the_remedies():
    model = load_model("prototype", [23.0, 6.0])
    words = preload_difference(model, NodeSettings(preload=(36.85, 6.0)))
    assert "upper 36.85 N in the estimator, 23 N here, lower 6 N in the estimator" in words
    assert "-p preload:=[23,6]" in words
    words = preload_difference(model, NodeSettings(preload=(36.85,)))
    assert "of another robot" in words


def test_a_node_that_leaves_out_estimates_is_refused():
    require_every_sample(NodeSettings())
    with pytest.raises(UsageError, match="publishes only some of its estimates"):
        require_every_sample(NodeSettings(max_rate_hz=100.0))


def test_the_last_answer_repeated_while_paused_is_not_counted(bench):
    bench.send(0, 1)
    bench.answer(0, 0, 0)
    assert bench.run.tally() == Tally(sent=4, expected=2, received=1)
