"""The lines of a picture are those of its channel, thinned without loss of peaks and gaps."""

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.evaluation.channels import Channel
from cdrj_ros.evaluation.metrics import envelope
from cdrj_ros.report.figures import COLOURS, channel_pictures, hysteresis, over_time

TIME = 0.01 * np.arange(60)
CHANNEL = Channel(
    name="tension/upper/1", unit="N", stamp_ns=np.round(1e9 * TIME).astype(np.int64),
    reference=30.0 + 3.0 * np.sin(9.0 * TIME), estimate=30.0 + 2.0 * np.sin(8.0 * TIME),
    angle=0.2 * np.cos(9.0 * TIME), angle_name="elbow",
)  # fmt: skip
"""So few samples that each has a point of the line."""


def assert_line(axes, role, x, *rows):
    """The axes have these lines in the colour of a role; a dot has one point."""
    lines = [one for one in axes.get_lines() if one.get_color() == COLOURS[role]]
    lines = [one for one in lines if len(one.get_xdata()) > 2]
    for line, y in zip(lines, rows, strict=True):
        np.testing.assert_allclose(line.get_xdata(), x)
        np.testing.assert_allclose(line.get_ydata(), y)


@pytest.mark.parametrize("part", [slice(None), slice(20, 50)])
def test_estimate_recording_and_error_are_drawn_over_time_and_angle(part):
    series, errors = over_time(CHANNEL, 0, part).axes
    reference, estimate = CHANNEL.reference[part], CHANNEL.estimate[part]
    assert_line(series, "truth", TIME[part], reference)
    assert_line(series, "estimate", TIME[part], estimate)
    assert_line(errors, "error", TIME[part], estimate - reference)
    (axes,) = hysteresis(CHANNEL, part).axes
    assert_line(axes, "truth", np.degrees(CHANNEL.angle[part]), reference)
    assert_line(axes, "estimate", np.degrees(CHANNEL.angle[part]), estimate)


def test_a_recording_of_few_reversals_is_not_drawn_twice():
    """Its largest error is enlarged from reversal to reversal, which is the whole of it."""
    slow = replace(CHANNEL, angle=0.1 * TIME)
    fast = replace(CHANNEL, angle=0.2 * np.cos(50.0 * TIME))
    captions = [
        [p.caption for p in channel_pictures(one, "k", 0, "", closer=True)] for one in (slow, fast)
    ]
    assert captions[0] == ["Whole recording.", "Over the angle of elbow, 0.0 to 0.6 s."]
    assert captions[1][:2] == [
        "Whole recording; the grey part is enlarged.", "Around the largest error."
    ]  # fmt: skip


def test_a_missing_stretch_breaks_the_line_and_a_missing_sample_does_not():
    for missing, broken in ((slice(20, 40), 1), (slice(20, 21), 0)):
        kept = np.delete(np.arange(60), missing)
        columns = {n: getattr(CHANNEL, n)[kept] for n in ("stamp_ns", "angle", "estimate")}
        channel = replace(CHANNEL, reference=CHANNEL.reference[kept], **columns)
        line = over_time(channel, 0).axes[0].get_lines()[0]
        assert np.isnan(line.get_ydata()).sum() == broken


@pytest.mark.parametrize("n", [1, 2, 639, 640, 641, 60_000, 600_007])
def test_the_envelope_keeps_the_peaks_of_every_bucket_in_few_points(n):
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
