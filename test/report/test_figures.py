"""The lines of a picture are those of its channel, thinned without loss of peaks and gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from numpy.typing import NDArray

from cdrj_ros.evaluation.channels import Channel
from cdrj_ros.evaluation.reversals import envelope, turning_points
from cdrj_ros.report.figures import COLOURS, around_largest_error, hysteresis, over_time

TIME = 0.01 * np.arange(60)
CHANNEL = Channel(
    name="tension/upper/1", unit="N", stamp_ns=np.round(1e9 * TIME).astype(np.int64),
    reference=30.0 + 3.0 * np.sin(9.0 * TIME), estimate=30.0 + 2.0 * np.sin(8.0 * TIME),
    angle=0.2 * np.cos(9.0 * TIME), angle_name="elbow",
)  # fmt: skip
"""So few samples that each has a point of the line."""


def assert_line(axes: Axes, role: str, x: NDArray[np.float64], *rows: NDArray[np.float64]) -> None:
    """The axes have these lines in the colour of a role; a dot has one point."""
    lines = [one for one in axes.get_lines() if one.get_color() == COLOURS[role]]
    lines = [one for one in lines if len(one.get_xdata()) > 2]
    for line, y in zip(lines, rows, strict=True):
        np.testing.assert_allclose(line.get_xdata(), x)
        np.testing.assert_allclose(line.get_ydata(), y)


@pytest.mark.parametrize("part", [slice(None), slice(20, 50)])
def test_estimate_recording_and_error_are_drawn_over_time_and_angle(part: slice) -> None:
    series, errors = over_time(CHANNEL, 0, part).axes
    reference, estimate = CHANNEL.reference[part], CHANNEL.estimate[part]
    assert_line(series, "truth", TIME[part], reference)
    assert_line(series, "estimate", TIME[part], estimate)
    assert_line(errors, "error", TIME[part], estimate - reference)
    (axes,) = hysteresis(CHANNEL, part).axes
    assert_line(axes, "truth", np.degrees(CHANNEL.angle[part]), reference)
    assert_line(axes, "estimate", np.degrees(CHANNEL.angle[part]), estimate)


def test_vectors_are_drawn_by_component_with_the_length_of_their_difference_below() -> None:
    force = np.stack([20.0 + TIME, -5.0 - TIME, np.full(60, 2.0)], axis=1)
    estimate = force + [3.0, 0.0, -4.0] * TIME[:, None]
    vectors = replace(CHANNEL, name="force_vector/a/2", reference=force, estimate=estimate)
    series, errors = over_time(vectors, 0).axes
    assert_line(series, "truth", TIME, *force.T)
    assert_line(series, "estimate", TIME, *estimate.T)
    assert_line(errors, "error", TIME, 5.0 * TIME)


def test_a_missing_stretch_breaks_the_line_and_a_missing_sample_does_not() -> None:
    for missing, broken in ((slice(20, 40), 1), (slice(20, 21), 0)):
        kept = np.delete(np.arange(60), missing)
        columns = {n: getattr(CHANNEL, n)[kept] for n in ("stamp_ns", "angle", "estimate")}
        channel = replace(CHANNEL, reference=CHANNEL.reference[kept], **columns)
        line = over_time(channel, 0).axes[0].get_lines()[0]
        assert np.isnan(line.get_ydata()).sum() == broken


@pytest.mark.parametrize("n", [1, 2, 639, 640, 641, 60_000, 600_007])
def test_the_envelope_keeps_the_peaks_of_every_bucket_in_few_points(n: int) -> None:
    one, two = np.random.default_rng(n).normal(size=(2, n))
    kept = envelope(320, one)
    assert len(kept) <= 2 * 320 + 2
    assert np.all(np.diff(kept) > 0)
    assert (kept[0], kept[-1]) == (0, n - 1)
    size = -(-n // 320)
    for start in range(0, n, size):
        inside = kept[(kept >= start) & (kept < start + size)]
        assert one[inside].max() == one[start : start + size].max()
        assert one[inside].min() == one[start : start + size].min()
    both = envelope(320, one, two)
    for series in (one, two):
        assert {int(series.argmax()), int(series.argmin())} <= set(both.tolist())


def test_turning_points_are_the_reversals_and_not_the_noise() -> None:
    time = np.arange(60_000) * 1e-3
    angle = 0.7 * np.sin(2 * np.pi * 0.1 * time)
    noisy = angle + np.random.default_rng(0).uniform(-0.01, 0.01, len(time))
    expected = 2500 + 5000 * np.arange(12)
    np.testing.assert_allclose(turning_points(angle), expected, atol=20)
    np.testing.assert_allclose(turning_points(noisy), expected, atol=400)
    for still in (time, np.zeros(100), np.full(100, np.nan)):
        assert len(turning_points(still)) == 0
    angle[:3000] = np.nan
    np.testing.assert_allclose(turning_points(angle), expected[1:], atol=20)


def test_the_enlarged_part_holds_the_largest_error_and_the_reversals_beside_it() -> None:
    n, angle = 60_000, np.sin(np.arange(60_000) * 2 * np.pi / 10_000)
    stamps = np.arange(n, dtype=np.int64) * 1_000_000
    for worst in (2600, 21_000, 33_333, 57_000):
        error = np.zeros(n)
        error[worst] = -1.0
        channel = Channel("tension/a/8", "N", stamps, error, np.zeros(n), angle, "q")
        part = around_largest_error(channel)
        assert part.start <= worst < part.stop
        assert part.stop - part.start == pytest.approx(15_000, abs=50)
        still = replace(channel, angle=np.full(n, np.nan))
        assert around_largest_error(still) == slice(0, n)
