"""The gates and the time line: offline equals online, and what is refused leaves no trace."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.conditioning import (
    CONFIRMATIONS,
    REFUSALS,
    Conditioner,
    Readings,
    condition,
)
from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.model.robot_file import load_robot

ROBOT = load_robot(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")
START = 1_700_000_000_000_000_000
Stream = list[tuple[int, float]]


def _streams(seed: int, n: int = 400) -> tuple[Stream, Stream]:
    """A motor at about 1 kHz and a joint at about 370 Hz, with jitter, in motion."""
    generator = np.random.default_rng(seed)
    streams = []
    for period, scale in ((1_000_000, 5.0), (2_700_000, 0.6)):
        stamps = START + np.cumsum(generator.integers(period // 2, 3 * period // 2, n))
        values = scale * np.sin((stamps - START) * 1e-9 * 2.0)
        streams.append(list(zip(stamps.tolist(), values.tolist(), strict=True)))
    return streams[0], streams[1]


def _feed(events: list[tuple[str, int, float]]) -> tuple[Conditioner, list[Sample]]:
    conditioner = Conditioner(ROBOT)
    samples: list[Sample] = []
    for kind, stamp, value in events:
        if kind == "motor":
            samples += conditioner.feed_motors(stamp, ("winch",), (value,))
        else:
            samples += conditioner.feed_joints(stamp, ("elbow",), (value,))
    return conditioner, samples


def _interleaved(motor: Stream, joint: Stream, seed: int) -> list[tuple[str, int, float]]:
    """Each topic in its own order, the two of them shuffled into each other."""
    generator = np.random.default_rng(seed)
    order = generator.permutation([0] * len(motor) + [1] * len(joint))
    sources = (iter([("motor", *one) for one in motor]), iter([("joint", *one) for one in joint]))
    return [next(sources[k]) for k in order]


def _same(samples: list[Sample], others: list[Sample]) -> bool:
    return [s.stamp_ns for s in samples] == [s.stamp_ns for s in others] and all(
        np.array_equal(a.motor_angle, b.motor_angle)
        and np.array_equal(a.joint_angle, b.joint_angle)
        for a, b in zip(samples, others, strict=True)
    )


def _readings(stream: Stream) -> Readings:
    stamps = np.array([stamp for stamp, _ in stream], dtype=np.int64)
    return Readings(stamps, stamps, np.array([value for _, value in stream]))


@pytest.mark.parametrize("seed", range(5))
def test_topics_may_arrive_in_any_interleaving(seed: int) -> None:
    motor, joint = _streams(seed)
    _, samples = _feed(_interleaved(motor, joint, seed))
    _, others = _feed(_interleaved(motor, joint, seed + 100))
    assert len(samples) > 350
    assert _same(samples, others)


@pytest.mark.parametrize("seed", range(5))
def test_the_offline_path_gives_the_same_samples_bit_for_bit(seed: int) -> None:
    motor, joint = _streams(seed)
    _, samples = _feed(_interleaved(motor, joint, seed))
    done = condition(ROBOT, {"winch": _readings(motor)}, {"elbow": _readings(joint)})
    (segment,) = done.segments
    assert segment.stamp_ns.tolist() == [s.stamp_ns for s in samples]
    assert np.array_equal(segment.motor_angle, np.array([s.motor_angle for s in samples]))
    assert np.array_equal(segment.joint_angle, np.array([s.joint_angle for s in samples]))


def test_every_reading_becomes_a_sample_at_its_own_stamp() -> None:
    motor, joint = _streams(7)
    _, samples = _feed(_interleaved(motor, joint, 7))
    by_stamp = {s.stamp_ns: s for s in samples}
    first = max(motor[0][0], joint[0][0])
    last = min(motor[-1][0], joint[-1][0])
    stamps = [s.stamp_ns for s in samples]
    assert stamps == sorted(set(stamps))
    for stamp, value in motor:
        if first <= stamp <= last:
            assert by_stamp[stamp].motor_angle[0] == value
    for stamp, value in joint:
        if first <= stamp <= last:
            assert by_stamp[stamp].joint_angle[0] == value


@pytest.mark.parametrize("seed", range(5))
def test_hostile_readings_leave_no_trace_and_are_counted(seed: int) -> None:
    motor, joint = _streams(seed)
    generator = np.random.default_rng(seed)
    clean = _interleaved(motor, joint, seed)
    expected = dict.fromkeys(REFUSALS, 0)
    conditioner = Conditioner(ROBOT)
    samples: list[Sample] = []
    last = {"motor": 0, "joint": 0}
    feeds = {"motor": conditioner.feed_motors, "joint": conditioner.feed_joints}
    names = {"motor": ("winch",), "joint": ("elbow",)}
    for kind, stamp, value in clean:
        before = last[kind]
        if before and generator.random() < 0.5:
            cause, when, angle, name = [
                ("not_finite", before + 1, float("nan"), names[kind]),
                ("not_finite", before + 1, float("-inf"), names[kind]),
                ("repeated", before, 0.1, names[kind]),
                ("late", before - 1, 0.1, names[kind]),
                ("late", before - 3600 * 10**9, 0.1, names[kind]),
                ("future", before + 3600 * 10**9, 0.1, names[kind]),
                ("unknown_name", before + 1, 0.1, ("stranger",)),
                ("unstamped", 0, 0.1, names[kind]),
                ("empty", before + 1, 0.1, ()),
                (
                    "out_of_range" if kind == "joint" else "implausible",
                    before + 1,
                    1e6,
                    names[kind],
                ),
            ][generator.integers(10)]
            expected[cause] += 1
            assert feeds[kind](when, name, (angle,) * len(name)) == []
            expected["malformed"] += 1
            assert feeds[kind](before + 1, names[kind], ()) == []
        samples += feeds[kind](stamp, names[kind], (value,))
        last[kind] = stamp
    _, undisturbed = _feed(clean)
    assert _same(samples, undisturbed)
    assert conditioner.refused == expected
    assert conditioner.accepted == len(clean)


def test_a_joint_among_the_motors_is_no_stranger() -> None:
    conditioner = Conditioner(ROBOT)
    conditioner.feed_motors(START, ("winch", "elbow"), (0.0, 0.1))
    assert conditioner.refused["unknown_name"] == 0
    assert conditioner.accepted == 1


def test_a_recording_that_loops_starts_anew_and_loses_none_of_the_second_pass() -> None:
    motor, joint = _streams(3)
    once = sorted(
        [("motor", *m) for m in motor] + [("joint", *j) for j in joint], key=lambda e: e[1]
    )
    shift = 5_000_000_000
    early = [(kind, stamp - shift, value) for kind, stamp, value in once]
    _, alone = _feed(early)
    conditioner, samples = _feed(once + early)
    assert conditioner.clock_jumps >= 1
    again = [s for s in samples if s.stamp_ns < once[0][1]]
    assert _same(again[-len(alone) + 2 * CONFIRMATIONS :], alone[2 * CONFIRMATIONS :])


def test_a_gap_goes_on_without_losing_a_reading() -> None:
    motor, joint = _streams(4)
    gap = 30_000_000_000
    motor = motor[:200] + [(stamp + gap, value) for stamp, value in motor[200:]]
    joint = joint[:80] + [(stamp + gap, value) for stamp, value in joint[80:]]
    conditioner, _ = _feed(_interleaved(motor, joint, 4))
    assert conditioner.clock_jumps == 0
    assert conditioner.gaps == 2
    assert conditioner.accepted == len(motor) + len(joint)


def test_the_slow_path_of_a_recording_agrees_with_feeding_it() -> None:
    motor, joint = _streams(5)
    motor[50] = (motor[50][0], float("nan"))
    events = sorted(
        [("motor", *m) for m in motor] + [("joint", *j) for j in joint], key=lambda e: e[1]
    )
    _, samples = _feed(events)
    done = condition(ROBOT, {"winch": _readings(motor)}, {"elbow": _readings(joint)})
    assert done.refused["not_finite"] == 1
    assert done.segments[0].stamp_ns.tolist() == [s.stamp_ns for s in samples]
