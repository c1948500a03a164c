"""The report: one HTML page that needs nothing but itself.

Verdict first, then the table, then pictures: the telling channels open, the others folded away.
Pictures are SVG inside the page.  Their lines are envelopes of a few hundred points, so their size
does not grow with the recording; for one picture that is less than half of what a PNG of the same
sharpness takes, and they follow the page into the dark and onto paper.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from string import Template
from typing import TYPE_CHECKING, Final

import numpy as np

from cdrj_ros.foundation.files import write_text
from cdrj_ros.judgement.comparison import QUANTITIES, BagComparison, Channel, quantity_of
from cdrj_ros.judgement.limits import Judgement
from cdrj_ros.judgement.metrics import (
    COVERAGE_SIGMAS,
    MINIMUM_SHARE,
    NO_SAMPLES,
    ChannelError,
    bag_errors,
    pooled_errors,
)
from cdrj_ros.judgement.reversals import AROUND_NS, REVERSAL_SHARE, turning_points
from cdrj_ros.report.numbers import format_amount, format_percent, format_r2
from cdrj_ros.report.parameters import parameter_tables
from cdrj_ros.report.series import (
    Window,
    closer_look,
    loop_window,
    seconds_since,
)
from cdrj_ros.report.table import (
    HEADINGS,
    OUTSIDE_HEADINGS,
    Row,
    headings_of,
    judgement_rows,
    judgement_sentence,
    table_groups,
)
from cdrj_ros.report.verdict import Verdict, origin_of, telling_channels, verdict
from cdrj_ros.robot.description import Robot

SHARE_IN_WORDS: Final = "difference of the two tensions over the larger one"

LOOP_IN_WORDS: Final = (
    "Friction over the cable that has passed the pulley where it holds most: upright where the "
    "cable sticks, level where it slips."
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE_BUDGET: Final = 2_700_000
"""Characters of pictures on one page; what does not fit is named instead of drawn."""


def write_report(
    path: str | os.PathLike[str],
    comparisons: Sequence[BagComparison],
    *,
    title: str,
    robot_summary: str,
    versions: Mapping[str, str],
    beside: Mapping[str, str] | None = None,
    beside_heading: str = "",
    judgement: Judgement | None = None,
    robot: Robot | None = None,
    drawing: Figure | None = None,
) -> None:
    """Write the comparisons as one self-contained HTML page, whole or not at all.

    Args:
        path: the file, replaced if it exists.
        comparisons: the recordings, in the order of the page.
        title: what the page is about, in a line.
        robot_summary: the robot and the parameters used, in a sentence or two.
        versions: names and versions of what produced the estimates.
        beside: text for one more column of the table by channel name, for example published
            figures; a quantity's prefix alone ("tension") names its last line.
        beside_heading: heading of that column.
        judgement: what came of limits, where there were any.
        robot: for the tables of its parameters.
        drawing: of the robot.

    Raises:
        OSError: the file cannot be written; an older one is then untouched.
    """
    errors = pooled_errors(comparisons)
    summary = verdict(comparisons, errors)
    page = Template(_asset("report.html")).substitute(
        title=escape(title),
        style=_asset("report.css").strip(),
        sentence=escape(summary.sentence),
        detail=escape(summary.detail),
        numbers=_numbers(summary),
        limits=_limits(judgement) if judgement else "",
        pooled=", all recordings together" if len(comparisons) > 1 else "",
        table=_table(errors, _anchors(comparisons), beside, beside_heading),
        bags="\n".join(_bags(comparisons)),
        robot=escape(robot_summary),
        drawing=_drawing(drawing, robot_summary) if drawing else "",
        parameters=_parameters(robot) if robot else "",
        sigmas=f"{COVERAGE_SIGMAS:g}",
        around=f"{AROUND_NS * 1e-9:g} s",
        back=f"{100.0 * REVERSAL_SHARE:g} %",
        versions=_rows(versions),
        share=f"{100.0 * MINIMUM_SHARE:g} %",
    )
    write_text(path, page)


def _asset(name: str) -> str:
    return (resources.files("cdrj_ros.report") / "assets" / name).read_text(encoding="utf-8")


def _numbers(summary: Verdict) -> str:
    if not summary.numbers:
        return ""
    tiles = "\n".join(
        f'<div><dt>{escape(number.label)}</dt><dd class="value">{escape(number.value)}</dd>'
        f"<dd>{escape(number.meaning)}</dd><dd>{escape(number.detail)}</dd></div>"
        for number in summary.numbers
    )
    return f'<dl class="numbers">\n{tiles}\n</dl>'


def _limits(judgement: Judgement) -> str:
    """Whether all is within its limits, and what is not."""
    kind = "outside" if judgement.outside else "within"
    sentence = f'<p class="limits {kind}">{escape(judgement_sentence(judgement))}</p>'
    rows = judgement_rows(judgement)
    return sentence + (_text_table(OUTSIDE_HEADINGS, rows, "outside") if rows else "")


def _text_table(headings: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "text") -> str:
    """A table of text whose first column names the row."""
    head = "".join(f'<th scope="col">{escape(heading)}</th>' for heading in headings)
    body = "\n".join(
        f'<tr><th scope="row">{escape(first)}</th>'
        + "".join(f"<td>{escape(cell)}</td>" for cell in rest)
        + "</tr>"
        for first, *rest in rows
    )
    return (
        f'<div class="wide"><table class="{kind}"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _parameters(robot: Robot) -> str:
    return "\n".join(
        _text_table((table.title, *table.headings), table.rows) for table in parameter_tables(robot)
    )


def _drawing(drawing: Figure, label: str) -> str:
    from cdrj_ros.report.svg import inline_svg

    return f'<figure class="drawing">{inline_svg(drawing, label, "drawing")}</figure>'


def _friction(comparison: BagComparison, key: str) -> str:
    """Bars of every pulley's friction and the loop of the one that holds most."""
    pulleys = comparison.friction
    if not pulleys:
        return ""
    from cdrj_ros.report.figures import MOST_BARS, friction_bars, friction_loop
    from cdrj_ros.report.svg import inline_svg

    least = sorted((one.mean_share for one in pulleys), reverse=True)[:MOST_BARS][-1]
    shown = [one for one in pulleys if one.mean_share >= least][:MOST_BARS]
    which = "every pulley" if len(shown) == len(pulleys) else f"the {len(shown)} that hold most"
    figures = [
        (
            inline_svg(friction_bars(shown), "Friction of the pulleys", f"{key}-bars"),
            f"What friction holds at {which}, by node: {SHARE_IN_WORDS}, as estimated.",
        )
    ]
    most = max(pulleys, key=lambda one: one.mean_share)
    if most.friction is not None and len(most.friction):
        loop = inline_svg(friction_loop(most), f"Friction loop of {most.name}", f"{key}-loop")
        figures.append((loop, LOOP_IN_WORDS))
    body = "\n".join(
        f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"
        for picture, caption in figures
    )
    line = (
        f"most at {most.name}: mean {format_percent(most.mean_share)}, "
        f"{format_amount(most.mean, 'N')}; largest {format_percent(most.largest_share)}"
    )
    return (
        f'<section class="channel"><h3>Friction at the pulleys <span class="small">'
        f'{escape(line)}</span></h3><div class="pictures">{body}</div></section>'
    )


def _table(
    errors: Mapping[str, ChannelError],
    anchors: Mapping[str, str],
    beside: Mapping[str, str] | None = None,
    beside_heading: str = "",
) -> str:
    """The figures, one table per quantity; names lead to their pictures."""
    if not errors:
        return "<p>No channel was compared.</p>"

    def line(row: Row, with_aside: bool) -> str:
        label = escape(row.label)
        if row.name in anchors:
            label = f'<a href="#{anchors[row.name]}" title="{escape(row.name)}">{label}</a>'
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in row.cells)
        aside = f'<td class="beside">{escape(row.aside)}</td>' if with_aside else ""
        kind = "" if row.name else ' class="all"'
        return f'<tr{kind}><th scope="row">{label}</th>{cells}{aside}</tr>'

    tables = []
    groups = table_groups(errors, beside=beside)
    lines = {
        group.title: group.rows + ((group.summary,) if group.summary else ()) for group in groups
    }
    with_aside = any(row.aside for rows in lines.values() for row in rows)
    for group in groups:
        rows = lines[group.title]
        head = "".join(f'<th scope="col">{escape(heading)}</th>' for heading in headings_of(errors))
        if with_aside:
            head += f'<th scope="col" class="beside">{escape(beside_heading)}</th>'
        body = "\n".join(line(row, with_aside) for row in rows)
        tables.append(
            f'<table>\n<thead><tr><th scope="col">{escape(group.title)}</th>{head}</tr></thead>\n'
            f"<tbody>{body}</tbody>\n</table>"
        )
    kind = "tables many" if len(headings_of(errors)) > len(HEADINGS) else "tables"
    return f'<div class="{kind}">\n' + "\n".join(tables) + "\n</div>"


def _rows(rows: Mapping[str, str]) -> str:
    if not rows:
        return ""
    lines = "\n".join(
        f"<dt>{escape(str(name))}</dt><dd>{escape(str(value))}</dd>" for name, value in rows.items()
    )
    return f'<dl class="rows">\n{lines}\n</dl>'


def _anchor(bag: int, channel: int) -> str:
    return f"bag{bag + 1}-channel{channel + 1}"


def _anchors(comparisons: Sequence[BagComparison]) -> dict[str, str]:
    """Where each channel is first shown."""
    anchors: dict[str, str] = {}
    for bag, comparison in enumerate(comparisons):
        for index, channel in enumerate(comparison.channels):
            anchors.setdefault(channel.name, _anchor(bag, index))
    return anchors


def _bags(comparisons: Sequence[BagComparison]) -> list[str]:
    """A section per recording; every recording's telling channels are drawn before any other."""
    errors = [bag_errors(comparison) for comparison in comparisons]
    telling = [
        telling_channels([channel.name for channel in comparison.channels])
        for comparison in comparisons
    ]
    budget = PICTURE_BUDGET
    drawn: dict[tuple[int, str], str] = {}
    for first in (True, False):
        for bag, comparison in enumerate(comparisons):
            for index, channel in enumerate(comparison.channels):
                if (channel.name in telling[bag]) is not first:
                    continue
                text = _channel(
                    channel,
                    errors[bag].get(channel.name, NO_SAMPLES),
                    _anchor(bag, index),
                    origin_of(comparison),
                    f"{comparison.path}, " if len(comparisons) > 1 else "",
                    pictures=budget > 0,
                )
                budget -= len(text)
                drawn[bag, channel.name] = text
    sections = []
    for bag, comparison in enumerate(comparisons):
        parts = [_facts(comparison)]
        if len(comparisons) > 1:
            table = _table(
                errors[bag], {name: _anchor(bag, i) for i, name in enumerate(errors[bag])}
            )
            heading = "<summary>Error of every channel in this recording</summary>"
            parts.append(f"<details>{heading}{table}</details>")
        parts += [drawn[bag, name] for name in telling[bag]]
        parts.append(_friction(comparison, f"bag{bag + 1}-friction"))
        parts += _folded(
            comparison, telling[bag], {n: t for (b, n), t in drawn.items() if b == bag}
        )
        body = "\n".join(parts)
        sections.append(f"<section>\n<h2>{escape(comparison.path)}</h2>\n{body}\n</section>")
    return sections


def _facts(comparison: BagComparison) -> str:
    """Length, counters, facts and notes of one recording."""
    counted = {cause: n for cause, n in comparison.counters.items() if n}
    rows = {"length": f"{comparison.duration_s:.1f} s", **comparison.facts}
    if comparison.counters:
        listed = ", ".join(f"{cause.replace('_', ' ')}: {n}" for cause, n in counted.items())
        rows["samples left out"] = listed or "none"
    notes = "".join(f"<li>{escape(note)}</li>" for note in comparison.notes)
    return _rows(rows) + (f'\n<ul class="notes">{notes}</ul>' if notes else "")


def _folded(
    comparison: BagComparison, telling: Sequence[str], drawn: Mapping[str, str]
) -> list[str]:
    """The channels that are not the telling ones, folded away by quantity."""
    parts = []
    for quantity, (title, _) in QUANTITIES.items():
        rest = [
            drawn[channel.name]
            for channel in comparison.channels
            if quantity_of(channel.name) == quantity and channel.name not in telling
        ]
        if rest:
            channels = "channel" if len(rest) == 1 else "channels"
            inside = "\n".join(rest)
            parts.append(
                f"<details><summary>{escape(title)}: {len(rest)} more {channels}</summary>\n"
                f"{inside}\n</details>"
            )
    return parts


def _channel(
    channel: Channel,
    error: ChannelError,
    anchor: str,
    origin_ns: int,
    label_start: str,
    *,
    pictures: bool,
) -> str:
    """One channel: its name, its figures in a line, its pictures."""
    if error.n == 0:
        line, body = "no samples", ""
    else:
        line = (
            f"mean |error| {format_amount(error.mean_abs_error, channel.unit)}, "
            f"{format_percent(error.mean_relative_error)}; "
            f"largest {format_amount(error.max_abs_error, channel.unit)}; "
            f"R² {format_r2(error.r2)}"
            + (f"; {format_percent(error.coverage, 1)} within ±2σ" if error.coverage else "")
        )
        body = (
            f'<div class="pictures">\n{_pictures(channel, anchor, origin_ns, label_start)}\n</div>'
            if pictures
            else '<p class="small">Not drawn, to keep the page small.</p>'
        )
    return (
        f'<section class="channel" id="{anchor}">\n<h3>{escape(channel.name)} '
        f'<span class="small">{escape(line)}</span></h3>\n{body}\n</section>'
    )


def _pictures(channel: Channel, anchor: str, origin_ns: int, label_start: str) -> str:
    # matplotlib takes half a second to import: only where something is drawn.
    from cdrj_ros.report.figures import hysteresis, over_time
    from cdrj_ros.report.svg import inline_svg

    turns = turning_points(channel.angle)
    look = closer_look(channel, turns)
    loop = loop_window(channel, turns)
    seconds = _span(channel, look, origin_ns)
    shown = [
        (
            over_time(channel, origin_ns, shade=look),
            "over time, error below",
            "Whole recording; the tinted part is enlarged.",
        ),
        (
            over_time(channel, origin_ns, window=look),
            f"over time, {seconds}, error below",
            "Around the largest error."
            if look.reversal is None
            else "The reversal (dashed) nearest to the largest error.",
        ),
    ]
    if np.isfinite(channel.angle[loop.begin : loop.end]).any():
        shown.append(
            (
                hysteresis(channel, loop),
                f"over the angle of {channel.angle_name}",
                f"Over the angle of {channel.angle_name}, {_span(channel, loop, origin_ns)}.",
            )
        )
    label = f"{label_start}{channel.name}: recorded and estimated"
    return "\n".join(
        f"<figure>{inline_svg(figure, f'{label} {view}', f'{anchor}-{index}')}"
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for index, (figure, view, caption) in enumerate(shown)
    )


def _span(channel: Channel, window: Window, origin_ns: int) -> str:
    begin, end = seconds_since(channel.stamp_ns[[window.begin, window.end - 1]], origin_ns)
    return f"{begin:.1f} to {end:.1f} s"
