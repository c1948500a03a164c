"""A node that estimates before all of its kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.estimators import Bench, feed, tensions

from cdrj_ros.commands.parts import OF_ESTIMATES
from cdrj_ros.model.status import UNSURE

JOINED = 150
"""Samples before the compilation is over."""


class Compiling:
    """Stands for processes that compile until they are told to end."""

    def __init__(self, *parts: str) -> None:
        self.parts = parts
        self.over = self.ended = False

    def runs(self) -> bool:
        return not self.over

    def end(self) -> None:
        self.ended = True


@pytest.fixture
def bench(ros: None) -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[list[str], list[str]]]]:
    """Parts that a node needs at once and later; none is compiled."""
    from cdrj_ros.nodes import estimator

    found: list[tuple[list[str], list[str]]] = []

    def note(_: str, needed: list[str], later: list[str], __: Callable[[], object]) -> None:
        found.append((needed, later))

    monkeypatch.setattr(estimator, "compile_for_estimates", note)
    return found


def _compiling(monkeypatch: pytest.MonkeyPatch, *parts: str) -> Compiling:
    """What the next node takes for its compilation."""
    from cdrj_ros.nodes import estimator

    compilation = Compiling(*parts)
    monkeypatch.setattr(estimator, "compile_for_estimates", lambda *_: compilation)
    return compilation


def _stddevs(node: Any) -> np.ndarray:
    return np.array([output.stddev for output in node.outputs])


def test_tensions_come_first_and_are_unsure_until_their_standard_deviations_come(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = bench.estimator()
    compilation = _compiling(monkeypatch, "members")
    node = bench.estimator("-r", "__node:=first")
    for one in (usual, node):
        feed(one, 0, JOINED)
    assert node.live.spread_is_late
    compilation.over = True
    assert bench.until(lambda: not node.live.spread_is_late)
    for one in (usual, node):
        feed(one, JOINED, 2 * JOINED)
    status = np.array([output.estimate.status for output in node.outputs]).astype(int)
    assert (status[:JOINED] & UNSURE != 0).all()
    assert np.isposinf(_stddevs(node)[:JOINED]).all()
    assert tensions(node).tobytes() == tensions(usual).tobytes()
    assert len(node.outputs) == 2 * JOINED  # none is lost
    assert _stddevs(node)[JOINED:].tobytes() == _stddevs(usual)[JOINED:].tobytes()
    assert np.isfinite(_stddevs(usual)).all()
    for one in node, usual:
        assert one.live.unsolved == 0


def test_where_compiling_fails_estimates_go_on_without_standard_deviations(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cdrj_ros.nodes import late_kernels

    compilation = _compiling(monkeypatch, "members")
    monkeypatch.setattr(late_kernels, "missing", lambda parts: parts[:1])
    node = bench.estimator()
    compilation.over = True
    assert bench.until(lambda: compilation.ended)
    feed(node, 0, JOINED)
    assert len(node.outputs) == JOINED
    assert np.isposinf(_stddevs(node)).all()
    assert np.isfinite(tensions(node)).all()


def test_a_node_that_ends_ends_its_compilation(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    compilation = _compiling(monkeypatch, "members")
    node = bench.estimator()
    bench.executor.remove_node(node)
    bench.estimators.remove(node)
    node.destroy_node()
    assert compilation.ended


@pytest.mark.parametrize(
    ("given", "state_file", "needed", "later"),
    [
        ({}, False, [], ["members"]),
        ({"uncertainty": False}, False, [], []),
        ({"tension_sensors": True}, False, ["members"], []),
        ({"track_preload": True}, False, ["members"], []),
        ({}, True, ["members"], []),
    ],
)
def test_a_node_waits_for_what_cannot_follow(
    given: dict[str, bool],
    state_file: bool,
    needed: list[str],
    later: list[str],
    bench: Bench,
    asked: list[tuple[list[str], list[str]]],
    tmp_path: Path,
) -> None:
    node = bench.estimator(state_file=tmp_path / "state" if state_file else None, **given)
    assert asked == [([*OF_ESTIMATES, *needed], later)]
    assert not node.live.spread_is_late


def test_a_managed_node_waits_for_all_kernels(
    ros: None, asked: list[tuple[list[str], list[str]]]
) -> None:
    from rclpy.parameter import Parameter

    from cdrj_ros.nodes.managed import SUCCESS, ManagedEstimator

    node = ManagedEstimator(parameter_overrides=[Parameter("robot", value="prototype")])
    try:
        assert node.trigger_configure() == SUCCESS
        assert asked == [([*OF_ESTIMATES, "members"], [])]
    finally:
        node.trigger_cleanup()
        node.destroy_node()
