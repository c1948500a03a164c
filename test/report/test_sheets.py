"""A picture on a figure that has been used is the one on a new figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from cdrj_ros.judgement.channels import Channel
from cdrj_ros.report.canvas import Sheets, inline_svg
from cdrj_ros.report.figures import hysteresis, over_time
from cdrj_ros.report.pictures import Window

MILLISECOND = 1_000_000


def channel(
    reference: Sequence[float], error: float, half: float | None, *, gap: int = 0
) -> Channel:
    n = len(reference)
    stamps = MILLISECOND * np.arange(n, dtype=np.int64)
    stamps[n // 2 :] += gap * MILLISECOND
    truth = np.array(reference)
    return Channel(
        name="tension/upper/1", unit="N", stamp_ns=stamps, reference=truth,
        estimate=truth + error * np.cos(np.arange(n)), angle=0.1 * np.sin(0.1 * np.arange(n)),
        angle_name="elbow", stddev=None if half is None else np.full(n, 0.5 * half),
    )  # fmt: skip


CHANNELS = (
    channel(30.0 + np.sin(np.arange(200)), 0.1, 0.3),
    channel(np.linspace(500.0, 900.0, 90), 20.0, None, gap=700),
    channel([4.0, 4.0, 4.0], 0.0, None),  # a horizontal line without error
    channel([1.0], 0.5, 5.0),
    channel(3.0 * np.sin(0.2 * np.arange(70)), 0.01, 2.0, gap=300),
)


def pictures(one: Channel, sheets: Sheets | None) -> list[str]:
    n = len(one.stamp_ns)
    part = Window(n // 3, n, n // 3)

    def svg(figure: Figure) -> str:
        return inline_svg(figure, "a channel", "key")

    return [
        svg(over_time(one, 0, shade=part, sheets=sheets)),
        svg(over_time(one, 0, window=part, sheets=sheets)),
        svg(hysteresis(one, part, sheets=sheets)),
    ]


def test_nothing_of_an_earlier_picture_remains() -> None:
    sheets = Sheets()
    for one in (*CHANNELS, *reversed(CHANNELS)):
        assert pictures(one, sheets) == pictures(one, None)


def test_axes_at_the_same_places_are_made_once() -> None:
    sheets = Sheets()
    first, _ = sheets.blank((40.0, 100.0))
    again, axes = sheets.blank((40.0, 100.0))
    other, both = sheets.blank((40.0, 100.0), (180.0, 50.0))
    assert again is first
    assert other is not first
    assert (len(axes), len(both)) == (1, 2)
