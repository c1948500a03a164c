"""Reading quality of service from files."""

from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.nodes.qos import DEPTH
from cdrj_ros.nodes.qos_files import read_overrides, was_latched


def _read(tmp_path: Path, text: str) -> dict[str, object]:
    path = tmp_path / "qos.yaml"
    path.write_text(text)
    return read_overrides(str(path))


def test_policies_are_read_by_name_and_by_number(tmp_path: Path) -> None:
    profiles = _read(
        tmp_path,
        "/a: {reliability: best_effort, durability: transient_local, depth: 7}\n"
        "/b: {reliability: 1, history: 2, deadline: {sec: 1, nsec: 5}}\n",
    )
    a, b = profiles["/a"], profiles["/b"]
    assert a.reliability == ReliabilityPolicy.BEST_EFFORT
    assert a.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert a.depth == 7
    assert b.reliability == ReliabilityPolicy.RELIABLE
    assert b.history == HistoryPolicy.KEEP_ALL
    assert b.deadline.nanoseconds == 1_000_000_005
    assert b.depth == DEPTH


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- a\n", "must map topics to policies"),
        ("/a: 3\n", "/a must map policies to values"),
        ("/a: {speed: fast}\n", "no policy 'speed'"),
        ("/a: {reliability: often}\n", "must be one of"),
        ("/a: {depth: 0}\n", "positive whole number"),
        ("/a: {deadline: 3}\n", "must be {sec: S, nsec: N}"),
        ("{", "is not YAML"),
    ],
)
def test_an_invalid_file_is_refused_with_the_place_of_the_error(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(UsageError, match=words.replace("{", r"\{")):
        _read(tmp_path, text)


@pytest.mark.parametrize(
    ("offered", "latched"),
    [
        ("- history: 1\n  durability: 1\n", True),
        ("- durability: transient_local\n", True),
        ("- durability: 2\n", False),
        ("", False),
        ("{", False),
    ],
)
def test_a_latched_topic_is_recognised(offered: str, latched: bool) -> None:
    assert was_latched(offered) is latched
