"""The head of the report summarises the figures in words."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.evaluation.channels import BagComparison, Channel
from cdrj_ros.evaluation.metrics import errors_of
from cdrj_ros.report.verdict import key_channels, last_elements, verdict


def scaled(name: str, factor: float) -> Channel:
    n = 1001
    unit = "N·m" if name.startswith("effort") else "N"
    base = np.sin(np.linspace(0.0, 20.0, n)) + (0.0 if unit == "N·m" else 10.0)
    stamps = np.arange(n, dtype=np.int64) * 10_000_000
    return Channel(name, unit, stamps, factor * base, base, np.full(n, np.nan), "")


def summed(*channels: Channel) -> str:
    bag = BagComparison("bags/one", 10.0, channels)
    return verdict(errors_of([bag])).sentence


@pytest.mark.parametrize(
    ("factor", "word"),
    [(1.01, "closely"), (1.04, " well"), (0.9, "roughly"), (0.7, "do not follow")],
)
def test_the_words_grow_weaker_with_the_error(factor: float, word: str) -> None:
    assert word in summed(scaled("tension/upper/1", factor), scaled("tension/upper/2", factor))


def test_the_sentence_names_the_mean_over_channels() -> None:
    sentence = summed(scaled("tension/upper/1", 1.01), scaled("tension/upper/2", 1.03))
    assert "2.00 %" in sentence


def test_efforts_are_judged_by_the_variation_they_explain() -> None:
    assert "follows the recording closely: 99.0 % of its variation" in summed(
        scaled("effort/spindle", 0.9)
    )
    assert "does not follow" in summed(scaled("effort/spindle", -1.0))


def test_the_largest_error_is_named_with_its_moment() -> None:
    spoilt = scaled("tension/upper/2", 1.0)
    spoilt.estimate[700] += 5.0
    bag = BagComparison("bags/one", 10.0, (scaled("tension/upper/1", 1.0), spoilt))
    detail = verdict(errors_of([bag])).detail
    assert "5.0 N, in tension/upper/2 at 7.0 s" in detail
    clean = BagComparison("bags/two", 10.0, (scaled("tension/upper/2", 1.0),))
    both = verdict(errors_of([clean, bag])).detail
    assert "at 7.0 s of bags/one" in both
    assert "20 s in 2 recordings" in both


def test_the_verdict_states_that_nothing_was_compared() -> None:
    assert verdict(errors_of([])).sentence.startswith("Nothing could be compared")
    assert verdict(errors_of([])).numbers == ()


def test_key_numbers_cover_last_elements_and_every_quantity(comparison: BagComparison) -> None:
    numbers = verdict(errors_of([comparison])).numbers
    assert [number.label for number in numbers] == [
        "Last element of each cable",
        "All 16 element tensions",
        "All 14 nodal forces",
        "Both efforts",
    ]


def test_the_key_channels_are_those_of_the_source(comparison: BagComparison) -> None:
    names = [channel.name for channel in comparison.channels]
    assert last_elements(names) == ("tension/upper/8", "tension/lower/8")
    assert key_channels(names) == (
        "tension/upper/8",
        "tension/lower/8",
        "nodal_force/upper/3",
        "nodal_force/lower/3",
        "effort/spindle",
        "effort/rolling",
    )


def test_elements_are_ordered_as_numbers() -> None:
    names = [f"tension/upper/{i}" for i in (9, 10, 2)]
    assert last_elements(names) == ("tension/upper/10",)
    assert key_channels([f"nodal_force/a/{i}" for i in (1, 2)]) == ("nodal_force/a/2",)
    assert key_channels(["friction/a/1"]) == ("friction/a/1",)
