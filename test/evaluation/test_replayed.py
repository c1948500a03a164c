"""Messages of the replay about an estimator whose settings differ from the expected ones."""

from __future__ import annotations

import pytest

from cdrj_ros.evaluation.replayed import (
    NodeSettings,
    preload_difference,
    require_every_sample,
    slow_playback,
)
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.loading import load_model


def test_preloads_that_agree_or_are_unknown_are_not_mentioned() -> None:
    model = load_model("prototype", [23.0, 6.0])
    for preload in ((), (23.0, 6.0), (23.0 + 1e-9, 6.0)):
        assert preload_difference(model, NodeSettings(preload=preload)) == ""


def test_preloads_that_differ_are_named_with_both_values_and_the_remedies() -> None:
    model = load_model("prototype", [23.0, 6.0])
    words = preload_difference(model, NodeSettings(preload=(36.85, 6.0)))
    assert "upper 36.85 N in the estimator, 23 N here, lower 6 N in the estimator" in words
    assert "-p preload:=[23,6]" in words
    assert "--use-node-preload" in words
    words = preload_difference(model, NodeSettings(preload=(36.85,)))
    assert "of another robot" in words


def test_a_node_that_leaves_out_estimates_is_refused() -> None:
    require_every_sample(NodeSettings())
    with pytest.raises(UsageError, match="publishes only some of its estimates"):
        require_every_sample(NodeSettings(max_rate_hz=100.0))


def test_a_slow_playback_without_a_clock_is_announced() -> None:
    assert "STALE" in slow_playback(0.5, clock=False)
    assert slow_playback(0.5, clock=True) == ""
    for rate in (None, 1.0, 20.0):
        assert slow_playback(rate, clock=False) == ""
