"""Playback from real files: by log time, by header stamp, and several bags merged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.bag import BagWriter, RawMessage, Topics, read_recording
from cdrj_ros.replay.playback import Playback, log_order, merged_source, stamp_order

MS = 1_000_000
TOPICS = Topics()


def _bag(path: Path, topic: str, stamps_ms: list[int]) -> str:
    stamps = np.array(stamps_ms, np.int64) * MS
    with BagWriter(path) as bag:
        bag.write_joint_states(topic, stamps, ("a",), position=stamps[:, None] * 1e-9)
    return str(path)


@pytest.fixture
def two(tmp_path: Path) -> list[str]:
    """Motors and joints of one recording session in two bags."""
    return [
        _bag(tmp_path / "motors", TOPICS.motors, list(range(1000, 1100, 2))),
        _bag(tmp_path / "joints", TOPICS.joints, list(range(1001, 1101, 2))),
    ]


def test_bags_recorded_side_by_side_play_as_one(two: list[str]) -> None:
    reel = log_order(merged_source(two), [TOPICS.motors, TOPICS.joints])
    playback = Playback(reel, 1010 * MS, 1019 * MS)
    playback.start(0.0)
    messages = playback.take(0.0, 100)
    assert [m.log_ns // MS for m in messages] == list(range(1010, 1020))
    assert [m.topic for m in messages[:2]] == [TOPICS.motors, TOPICS.joints]


def test_bags_recorded_side_by_side_are_read_as_one(two: list[str]) -> None:
    recording = read_recording(merged_source(two))
    assert list(recording.motors) == ["a"]
    assert recording.joints["a"].stamp_ns[0] == 1001 * MS
    assert (recording.start_ns, recording.end_ns) == (1000 * MS, 1099 * MS)


def test_the_order_of_stamps_undoes_a_delay_in_recording(two: list[str]) -> None:
    def stamp(message: RawMessage) -> int:
        return message.log_ns - (5 * MS if message.topic == TOPICS.joints else 0)

    reel, first, last = stamp_order(merged_source(two), [TOPICS.motors, TOPICS.joints], stamp)
    times = [m.log_ns for m in reel(first)]
    assert times == sorted(times)
    assert (first, last) == (996 * MS, 1098 * MS)
    assert next(reel(1007 * MS)).log_ns >= 1007 * MS


def test_messages_without_a_stamp_keep_their_log_time(two: list[str]) -> None:
    reel, first, last = stamp_order(merged_source(two[:1]), [TOPICS.motors], lambda _: 0)
    assert (first, last) == (1000 * MS, 1098 * MS)
    assert sum(1 for _ in reel(first)) == 50
