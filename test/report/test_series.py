"""Thinning of long series preserves peaks and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.evaluation.channels import Channel
from cdrj_ros.evaluation.reversals import envelope, envelopes, turning_points
from cdrj_ros.report.pictures import closer_look, gaps, loop_window


def made(angle: np.ndarray, error: np.ndarray, step_ns: int = 1_000_000) -> Channel:
    n = len(angle)
    stamps = 1_722_000_000_000_000_000 + np.arange(n, dtype=np.int64) * step_ns
    return Channel("tension/upper/8", "N", stamps, error, np.zeros(n), angle, "rolling")


@pytest.mark.parametrize("n", [1, 2, 639, 640, 641, 60_000, 600_007])
def test_the_envelope_keeps_every_buckets_peaks_in_few_points(n: int) -> None:
    series = np.random.default_rng(n).normal(size=n)
    kept = envelope(320, series)
    assert len(kept) <= max(2 * 320 + 2, 2 * 320)
    assert np.all(np.diff(kept) > 0)
    assert kept[0] == 0
    assert kept[-1] == n - 1
    size = -(-n // 320)
    for start in range(0, n, size):
        bucket = slice(start, start + size)
        inside = kept[(kept >= start) & (kept < start + size)]
        assert series[inside].max() == series[bucket].max()
        assert series[inside].min() == series[bucket].min()


@pytest.mark.parametrize("n", [3, 640, 50_001])
def test_an_envelope_of_several_series_keeps_the_peaks_of_each(n: int) -> None:
    one, two = np.random.default_rng(n).normal(size=(2, 5, n))
    for row, x, y in zip(envelopes(100, one, two), one, two, strict=True):
        kept = np.unique(row)
        assert kept.tolist() == envelope(100, x, y).tolist()
        for series in (x, y):
            assert {int(series.argmax()), int(series.argmin())} <= set(kept.tolist())


def test_a_missing_stretch_breaks_the_line() -> None:
    stamps = np.arange(10_000, dtype=np.int64) * 1_000_000
    assert len(gaps(stamps)) == 0
    assert gaps(np.delete(stamps, np.arange(4001, 5000))).tolist() == [4000]
    assert len(gaps(np.delete(stamps, 4001))) == 0


def test_turning_points_are_the_reversals_and_not_the_noise() -> None:
    time = np.arange(60_000) * 1e-3
    angle = 0.7 * np.sin(2 * np.pi * 0.1 * time)
    noisy = angle + np.random.default_rng(0).uniform(-0.01, 0.01, len(time))
    expected = 2500 + 5000 * np.arange(12)
    np.testing.assert_allclose(turning_points(angle), expected, atol=20)
    np.testing.assert_allclose(turning_points(noisy), expected, atol=400)
    assert len(turning_points(time)) == 0
    assert len(turning_points(np.zeros(100))) == 0
    assert len(turning_points(np.full(100, np.nan))) == 0
    angle[:3000] = np.nan
    np.testing.assert_allclose(turning_points(angle), expected[1:], atol=20)


def test_the_detail_shows_the_largest_error_and_its_reversal() -> None:
    angle = np.sin(np.arange(60_000) * 2 * np.pi / 10_000)
    for worst in (0, 2600, 21_000, 33_333, 59_999):
        error = np.zeros(60_000)
        error[worst] = 1.0
        channel = made(angle, error)
        look = closer_look(channel, turning_points(angle))
        assert look.begin <= worst < look.end
        assert look.reversal is not None
        assert look.begin <= look.reversal < look.end
        assert look.end - look.begin < 15_000


def test_without_reversals_the_largest_error_is_shown() -> None:
    error = np.zeros(1000)
    error[600] = -2.0
    look = closer_look(made(np.full(1000, np.nan), error), turning_points(np.full(1000, np.nan)))
    assert look.begin <= 600 < look.end
    assert look.reversal is None
    assert look.end - look.begin < 200


def test_the_loop_shows_two_cycles_or_all_there_is() -> None:
    angle = np.sin(np.arange(60_000) * 2 * np.pi / 10_000)
    loop = loop_window(made(angle, np.zeros(60_000)), turning_points(angle))
    assert loop.end - loop.begin == pytest.approx(20_000, abs=50)
    short = made(angle[:4000], np.zeros(4000))
    loop = loop_window(short, turning_points(short.angle))
    assert (loop.begin, loop.end) == (0, 4000)


@pytest.mark.parametrize("n", [1, 2, 3, 10])
def test_very_short_recordings_have_windows(n: int) -> None:
    channel = made(np.sin(np.arange(n)), np.ones(n))
    turns = turning_points(channel.angle)
    for window in (closer_look(channel, turns), loop_window(channel, turns)):
        assert 0 <= window.begin < window.end <= n
