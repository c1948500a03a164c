"""The lines of a picture are those of its channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cdrj_ros.evaluation.channels import Channel
from cdrj_ros.evaluation.reversals import turning_points
from cdrj_ros.report import figures
from cdrj_ros.report.canvas import PALETTE, Sheets, inline_svg
from cdrj_ros.report.figures import hysteresis, over_time
from cdrj_ros.report.pictures import Window, channel_pictures, closer_look

TIME = 0.01 * np.arange(60)
CHANNEL = Channel(
    name="tension/upper/1", unit="N", stamp_ns=np.round(1e9 * TIME).astype(np.int64),
    reference=30.0 + 3.0 * np.sin(9.0 * TIME), estimate=30.0 + 2.0 * np.sin(8.0 * TIME),
    angle=0.2 * np.cos(9.0 * TIME), angle_name="elbow",
)  # fmt: skip
"""So few samples that each has a point of the line."""
PART = Window(20, 50, 30)


def line(axes: Axes, role: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The points of the line with the colour of a role; a dot has two."""
    drawn = [one for one in axes.get_lines() if one.get_color() == PALETTE[role]]
    points = max(drawn, key=lambda one: len(one.get_xdata()))
    return np.asarray(points.get_xdata()), np.asarray(points.get_ydata())


def assert_line(axes: Axes, role: str, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    drawn = line(axes, role)
    np.testing.assert_allclose(drawn[0], x)
    np.testing.assert_allclose(drawn[1], y)


def test_estimate_recording_and_error_are_drawn_over_time() -> None:
    for window, part in ((None, slice(None)), (PART, slice(20, 50))):
        series, errors = over_time(CHANNEL, 0, window=window).axes
        time, reference, estimate = TIME[part], CHANNEL.reference[part], CHANNEL.estimate[part]
        assert_line(series, "truth", time, reference)
        assert_line(series, "estimate", time, estimate)
        assert_line(errors, "error", time, estimate - reference)


def test_vectors_are_drawn_by_component_with_the_angle_between_them_below() -> None:
    angle = 0.1 + 0.05 * np.sin(5.0 * TIME)
    force = np.stack([20.0 + TIME, -5.0 - TIME, np.full(60, 2.0)], axis=1)
    estimate = np.stack(
        [
            np.cos(angle) * force[:, 0] - np.sin(angle) * force[:, 1],
            np.sin(angle) * force[:, 0] + np.cos(angle) * force[:, 1],
            force[:, 2],
        ],
        axis=1,
    )
    vectors = replace(CHANNEL, name="force_vector/a/2", reference=force, estimate=estimate)
    series, errors = over_time(vectors, 0).axes
    for role, values in (("truth", force), ("estimate", estimate)):
        drawn = [one for one in series.get_lines() if one.get_color() == PALETTE[role]]
        assert len(drawn) == 3
        for one, component in zip(drawn, values.T, strict=True):
            np.testing.assert_allclose(one.get_ydata(), component)
    assert [text.get_text() for text in series.texts] == ["x", "y", "z"]
    flat = np.hypot(force[:, 0], force[:, 1]) / np.linalg.norm(force, axis=1)
    between = 2.0 * np.arcsin(flat * np.sin(angle / 2.0))  # the chord is that in the plane
    assert_line(errors, "error", TIME, np.degrees(between))
    assert len(channel_pictures(vectors, "key", 0, "", Sheets())) == 2


def test_vectors_without_direction_are_drawn() -> None:
    nothing = np.zeros((60, 3))
    vectors = replace(CHANNEL, name="force_vector/a/2", reference=nothing, estimate=nothing)
    figure = over_time(vectors, 0)
    assert "no direction" in [text.get_text() for text in figure.texts]


def test_estimate_and_recording_are_drawn_over_the_angle() -> None:
    (axes,) = hysteresis(CHANNEL, PART).axes
    angle = np.degrees(CHANNEL.angle[20:50])
    assert_line(axes, "truth", angle, CHANNEL.reference[20:50])
    assert_line(axes, "estimate", angle, CHANNEL.estimate[20:50])


def test_the_part_that_is_tinted_is_enlarged(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[dict[str, object]] = []

    def draw(channel: Channel, origin_ns: int, **how: object) -> Figure:
        seen.append(how)
        return over_time(channel, origin_ns)

    monkeypatch.setattr(figures, "over_time", draw)
    assert len(channel_pictures(CHANNEL, "key", 0, "", Sheets())) == 3
    look = closer_look(CHANNEL, turning_points(CHANNEL.angle))
    assert [one.get("shade") for one in seen] == [look, None]
    assert [one.get("window") for one in seen] == [None, look]


MILLISECOND = 1_000_000


def made(reference: Sequence[float], error: float, half: float | None, *, gap: int = 0) -> Channel:
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
    made(30.0 + np.sin(np.arange(200)), 0.1, 0.3),
    made(np.linspace(500.0, 900.0, 90), 20.0, None, gap=700),
    made([4.0, 4.0, 4.0], 0.0, None),  # a horizontal line without error
    made([1.0], 0.5, 5.0),
    made(3.0 * np.sin(0.2 * np.arange(70)), 0.01, 2.0, gap=300),
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
