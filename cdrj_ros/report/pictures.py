"""Pictures of a report as inline SVG, with captions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from cdrj_ros.judgement.channels import Channel
from cdrj_ros.judgement.pulley_friction import PulleyFriction
from cdrj_ros.judgement.reversals import turning_points
from cdrj_ros.report.series import Window, closer_look, loop_window, seconds_since

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

    from cdrj_ros.report.sheets import Sheets

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
    from cdrj_ros.report.friction_figures import MOST_BARS, friction_bars, friction_loop

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

    from cdrj_ros.report.svg import inline_svg

    return Picture(Markup(inline_svg(figure, label, key)), caption)


def _span(channel: Channel, window: Window, origin_ns: int) -> str:
    begin, end = seconds_since(channel.stamp_ns[[window.begin, window.end - 1]], origin_ns)
    return f"{begin:.1f} to {end:.1f} s"
