"""Pictures of a channel and of friction: which parts are drawn, with captions, as inline SVG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.evaluation.channels import Channel
from cdrj_ros.evaluation.pulley_friction import PulleyFriction
from cdrj_ros.evaluation.reversals import turning_points

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

    from cdrj_ros.report.canvas import Sheets


Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

GAP_STEPS: Final = 5.0
"""A line is broken where two stamps are further apart than this many median steps ..."""

GAP_SHARE: Final = 0.005
"""... and further apart than this share of the drawn time, so that the gap is visible."""

CYCLES: Final = 2
"""Number of motion cycles in a hysteresis loop; more cycles would overlap."""


@dataclass(frozen=True)
class Window:
    """A range of samples of a channel."""

    begin: int
    """First sample."""
    end: int
    """One past the last sample."""
    reversal: int | None
    """Sample of the reversal around which the window was chosen, None if there is none."""


def gaps(stamp_ns: NDArray[np.int64]) -> Indices:
    """Samples after which a line over these stamps must be broken, shape (k,)."""
    if len(stamp_ns) < 3:
        return np.arange(0)
    steps = np.diff(stamp_ns)
    span = float(stamp_ns[-1] - stamp_ns[0])
    return np.flatnonzero(steps > max(GAP_STEPS * float(np.median(steps)), GAP_SHARE * span))


def seconds_since(stamp_ns: NDArray[np.int64], origin_ns: int) -> Floats:
    """Stamps in seconds after an origin, subtracted as integers before conversion to float."""
    return (stamp_ns - origin_ns).astype(np.float64) * 1e-9


def worst_sample(channel: Channel) -> int:
    """The sample with the largest |estimate - reference|; the channel must not be empty."""
    return int(np.argmax(channel.error_size))


def closer_look(channel: Channel, turns: Indices) -> Window:
    """Window around the reversal nearest to the largest error, including both.

    The window extends to either side by a quarter of a motion cycle, or further to include the
    largest error.  If the joint does not reverse near the largest error, the window is centred on
    the error; if it never reverses, the window is a tenth of the recording.

    Args:
        channel: at least one sample.
        turns: its turning points.
    """
    worst = worst_sample(channel)
    stamps = channel.stamp_ns
    if len(turns):
        away = np.abs(stamps[turns] - stamps[worst])
        nearest = int(np.argmin(away))
        half_cycle = _half_cycle_ns(channel, turns)
        if away[nearest] <= half_cycle:
            reach = max(half_cycle // 2, int(away[nearest]) * 5 // 4)
            return _around(channel, int(turns[nearest]), reach, int(turns[nearest]))
        return _around(channel, worst, half_cycle, None)
    return _around(channel, worst, int(stamps[-1] - stamps[0]) // 20, None)


def loop_window(channel: Channel, turns: Indices) -> Window:
    """CYCLES cycles of motion around the closer look; the whole channel if there are fewer."""
    if len(turns) < 2:
        return Window(0, len(channel.stamp_ns), None)
    look = closer_look(channel, turns)
    centre = worst_sample(channel) if look.reversal is None else look.reversal
    return _around(channel, centre, CYCLES * _half_cycle_ns(channel, turns), look.reversal)


def _half_cycle_ns(channel: Channel, turns: Indices) -> int:
    """Median time from one reversal to the next [ns]."""
    stamps = channel.stamp_ns
    if len(turns) < 2:
        return int(stamps[-1] - stamps[0]) // 5
    return int(np.median(np.diff(stamps[turns])))


def _around(channel: Channel, centre: int, reach_ns: int, reversal: int | None) -> Window:
    """A window of ``reach_ns`` to either side of ``centre``, shifted into the recording."""
    stamps = channel.stamp_ns
    first, last = int(stamps[0]), int(stamps[-1])
    begin_ns = max(min(int(stamps[centre]) - reach_ns, last - 2 * reach_ns), first)
    end_ns = min(begin_ns + 2 * reach_ns, last)
    begin = int(np.searchsorted(stamps, begin_ns, side="left"))
    end = int(np.searchsorted(stamps, end_ns, side="right"))
    return Window(begin, max(end, begin + 1), reversal)


# matplotlib takes half a second to import, so the functions below import it only when they draw.

SHARE_IN_WORDS: Final = "difference of the two tensions over the larger one"

LOOP_IN_WORDS: Final = (
    "Friction over the cable that has passed the pulley where friction holds most: upright where "
    "the cable sticks, level where it slips."
)


class Picture(NamedTuple):
    """One figure of the page."""

    svg: Markup
    caption: str


def channel_pictures(
    channel: Channel, key: str, origin_ns: int, label_start: str, sheets: Sheets
) -> tuple[Picture, ...]:
    """Pictures of one channel: over time, around its largest error, and over its angle.

    Vectors are drawn over time only.

    Args:
        channel: at least one sample.
        key: identifier that is unique on the page.
        origin_ns: stamp at 0 s of the time axes [ns].
        label_start: beginning of the accessible label of the pictures.
        sheets: figures to draw on.
    """
    from cdrj_ros.report.figures import hysteresis, over_time

    label = f"{label_start}{channel.name}: recorded and estimated"
    below = "direction error below" if channel.is_vector else "error below"
    turns = turning_points(channel.angle)
    look = closer_look(channel, turns)
    loop = loop_window(channel, turns)
    seconds = _span(channel, look, origin_ns)
    whole = _picture(
        over_time(channel, origin_ns, shade=look, sheets=sheets),
        f"{label} over time, {below}",
        f"{key}-0",
        "Whole recording; the tinted part is enlarged.",
    )
    closer = _picture(
        over_time(channel, origin_ns, window=look, sheets=sheets),
        f"{label} over time, {seconds}, {below}",
        f"{key}-1",
        "Around the largest error."
        if look.reversal is None
        else "The reversal (dashed) nearest to the largest error.",
    )
    if channel.is_vector or not np.isfinite(channel.angle[loop.begin : loop.end]).any():
        return whole, closer
    turned = "position" if channel.angle_unit == "m" else "angle"
    over = f"the {turned} of {channel.angle_name}"
    looped = _picture(
        hysteresis(channel, loop, sheets=sheets),
        f"{label} over {over}",
        f"{key}-2",
        f"Over {over}, {_span(channel, loop, origin_ns)}.",
    )
    return whole, closer, looped


def friction_pictures(
    pulleys: Sequence[PulleyFriction], most: PulleyFriction, key: str
) -> tuple[Picture, ...]:
    """Bars of the pulleys' friction, and the loop of the pulley with the largest share."""
    from cdrj_ros.report.figures import MOST_BARS, friction_bars, friction_loop

    least = sorted((one.mean_share for one in pulleys), reverse=True)[:MOST_BARS][-1]
    shown = [one for one in pulleys if one.mean_share >= least][:MOST_BARS]
    which = "every pulley" if len(shown) == len(pulleys) else f"the {len(shown)} that hold most"
    caption = f"What friction holds at {which}, by node: {SHARE_IN_WORDS}, as estimated."
    pictures = [_picture(friction_bars(shown), "Friction of the pulleys", f"{key}-bars", caption)]
    if most.friction is not None and len(most.friction):
        label = f"Friction loop of {most.name}"
        pictures.append(_picture(friction_loop(most), label, f"{key}-loop", LOOP_IN_WORDS))
    return tuple(pictures)


def drawing_svg(drawing: Figure, label: str) -> Markup:
    """The drawing of the robot."""
    return _picture(drawing, label, "drawing", "").svg


def _picture(figure: Figure, label: str, key: str, caption: str) -> Picture:
    from markupsafe import Markup

    from cdrj_ros.report.canvas import inline_svg

    return Picture(Markup(inline_svg(figure, label, key)), caption)


def _span(channel: Channel, window: Window, origin_ns: int) -> str:
    begin, end = seconds_since(channel.stamp_ns[[window.begin, window.end - 1]], origin_ns)
    return f"{begin:.1f} to {end:.1f} s"
