"""Laws of the gates and the time line that hold for any messages in any order."""

from random import Random

import numpy as np
import pytest
from support.reading_streams import random_robot, random_stream, take
from support.wound import robot_of

from cdrj_ros._core import CONFIRMATIONS, RANGE_MARGIN, WAITING
from cdrj_ros.estimation.conditioner import MODES, Conditioner, axes_of
from cdrj_ros.estimation.refusals import WHOLE

BEGIN = 1_700_000_000 * 10**9
MILLISECOND = 1_000_000
OVER_ALL = "[1, {joint: p, slope: 0.02}, {joint: q, slope: 0.02}]"
ROBOT = robot_of(
    """
name: plain
motors: [{name: a, max_speed: 50}, {name: b}]
joints: [{name: p, range: [-1, 1], max_speed: 20}, {name: q, range: [0, 2]}]
""",
    span=OVER_ALL,
)


def any_streams(count=40):
    for seed in range(1000, 1000 + count):
        random = Random(seed)
        robot = random_robot(random)
        yield robot, random_stream(random, robot, 300)


def feed(conditioner, message):
    return take(conditioner, message.topic, message.stamp_ns, message.names, message.positions)


def bits(samples):
    return [tuple(np.asarray(one).tobytes() for one in sample) for sample in samples]


@pytest.mark.parametrize("mode", MODES)
def test_samples_are_finite_within_limits_and_later_than_the_one_before(mode):
    for robot, stream in any_streams():
        conditioner, limits = Conditioner(robot, mode), axes_of(robot)
        offsets = {limit.clock_offset_ns for limit in limits}
        possible = set()
        last, ahead, jumps, given_out = -1, -1, 0, 0
        for message in stream:
            possible |= {message.stamp_ns + offset for offset in offsets}
            samples = feed(conditioner, message)
            if conditioner.clock_jumps != jumps:
                jumps, last, ahead = conditioner.clock_jumps, -1, -1
            for sample in samples:
                assert sample.stamp_ns > max(last, 0)
                assert sample.stamp_ns in possible
                assert sample.silent == (sample.stamp_ns <= ahead)
                if sample.predicted:
                    assert not sample.silent
                    ahead = sample.stamp_ns
                else:
                    last = sample.stamp_ns
                    given_out += 1
                assert not np.isnan(sample.motor_angle[0]), "the only cable depends on it"
                for value, limit in zip(sample.angles, limits, strict=True):
                    if np.isnan(value):
                        continue
                    assert limit.lower - 2 * RANGE_MARGIN <= value
                    assert value <= limit.upper + 2 * RANGE_MARGIN
        assert given_out <= conditioner.accepted


def test_apart_from_predicted_samples_prediction_changes_nothing():
    """At most one is predicted by a message, and it comes last."""
    for robot, stream in any_streams():
        waiting, predicting = Conditioner(robot), Conditioner(robot, "predict")
        for message in stream:
            samples = feed(predicting, message)
            seen = [sample for sample in samples if not sample.predicted]
            told = [sample._replace(silent=False) for sample in seen]
            assert bits(told) == bits(feed(waiting, message))
            assert bits(samples[: len(seen)]) == bits(seen)
            assert len(samples) <= len(seen) + 1
        assert predicting.refused == waiting.refused


@pytest.mark.parametrize("mode", MODES)
def test_every_reading_is_accepted_refused_elsewhere_or_held_and_nothing_else(mode):
    for k, (robot, stream) in enumerate(any_streams()):
        conditioner = Conditioner(robot, mode)
        whole = readings = 0
        for place, message in enumerate(stream):
            if place == 5 * k:
                conditioner.reset()
                assert conditioner.held == 0
            feed(conditioner, message)
            is_right = len(message.names) == len(message.positions) > 0 < message.stamp_ns
            whole += not is_right
            readings += is_right * len(message.names)
            refused = conditioner.refused
            assert sum(refused[cause] for cause in WHOLE) == whole
            settled = conditioner.accepted + conditioner.elsewhere + conditioner.held
            assert settled + sum(refused.values()) - whole == readings
            assert all(len(held) < CONFIRMATIONS for held in conditioner.held_of.values())
            assert max(conditioner.waiting.values()) <= 2 * max(conditioner.accepted, 1)


def test_a_refused_message_leaves_no_trace():
    """If it leaves no held reading either, the same samples follow with and without it."""
    for robot, stream in any_streams():
        with_it, without = Conditioner(robot), Conditioner(robot)
        for message in stream:
            before = _traces(with_it)
            samples = feed(with_it, message)
            if _traces(with_it) == before:
                assert samples == []  # refused: the other conditioner does not get it
            else:
                assert bits(samples) == bits(feed(without, message))


def _traces(conditioner):
    """What a message changes that is not refused, or that puts those before it in doubt."""
    c = conditioner
    doubts = [c.refused[cause] for cause in ("implausible", "contradictory", "out_of_range")]
    return c.accepted, c.clock_jumps, c.held, c.held_of, doubts


@pytest.mark.parametrize("mode", MODES)
def test_a_channel_that_waits_in_vain_keeps_only_the_latest_readings(mode):
    conditioner = Conditioner(ROBOT, mode)
    begin, lost = BEGIN, 900
    first, last = WAITING + lost, 2 * WAITING
    recent = 1000

    def motors(k):
        return take(conditioner, "motors", begin + k * MILLISECOND, ("a", "b"), (0.0, 0.001 * k))

    def joints(k):
        return take(conditioner, "joints", begin + k * MILLISECOND, ("p", "q"), (0.0, 1.0))

    for k in range(first):
        assert motors(k) == []
    assert max(conditioner.waiting.values()) <= WAITING + recent
    assert conditioner.crowded == 2 * lost
    assert conditioner.accepted == 2 * first
    assert [sample.stamp_ns for sample in joints(first - 1)] == [begin + (first - 1) * MILLISECOND]

    for k in range(first, first + last):  # the joints fall silent again
        motors(k)
    assert max(conditioner.waiting.values()) <= WAITING + recent
    found = [
        sample
        for k in range(first + last - 10, first + last + 100)
        for sample in joints(k)
        if not sample.predicted
    ]
    stamps = [sample.stamp_ns for sample in found]
    assert stamps == sorted(set(stamps))
    assert stamps[0] > begin + (first - 1) * MILLISECOND
    assert begin + (first + last - 1) * MILLISECOND in stamps
    for sample in found:  # motor b was read at every stamp
        k = (sample.stamp_ns - begin) // MILLISECOND
        assert sample.motor_angle[1] == pytest.approx(0.001 * k, abs=1e-9)
