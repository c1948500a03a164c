"""The report: one self-contained HTML page.

The verdict comes first, then the table, then the pictures; only those of the most informative
channels are unfolded.  Pictures are inline SVG.  Their lines are envelopes of a few hundred points,
so their size does not grow with the recording; an SVG takes less than half the size of an equally
sharp PNG, and it adopts the page's colours in dark mode and in print.

``assets/report.html`` is a Jinja template that escapes all text; this module provides its values.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Any, Final

from cdrj_ros.evaluation.channels import QUANTITIES, BagComparison, Channel, quantity_of
from cdrj_ros.evaluation.limits import LimitCheck
from cdrj_ros.evaluation.metrics import (
    COVERAGE_SIGMAS,
    DIRECTION_SHARE,
    MINIMUM_SHARE,
    NO_SAMPLES,
    ChannelError,
    Errors,
)
from cdrj_ros.evaluation.reversals import AROUND_NS, REVERSAL_SHARE
from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.text import counted, printable
from cdrj_ros.inspection.checks import Inspection, Suspicion
from cdrj_ros.report.parameters import cable_tables, headline, parameter_tables
from cdrj_ros.report.pictures import Picture, channel_pictures, drawing_svg, friction_pictures
from cdrj_ros.report.table import (
    HEADINGS,
    OUTSIDE_HEADINGS,
    Beside,
    cause_in_words,
    format_amount,
    format_percent,
    format_r2,
    headings_of,
    limits_sentence,
    outside_rows,
    table_groups,
)
from cdrj_ros.report.verdict import (
    direction_words,
    health_lines,
    key_channels,
    origin_of,
    verdict,
)
from cdrj_ros.robot.description import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cdrj_ros.report.canvas import Sheets


def template(name: str) -> Any:
    """A template of ``assets/``, which may import others from there."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        autoescape=True,
        finalize=_shown,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(_asset),
    )
    return environment.get_template(name)


def _shown(value: object) -> object:
    """Text of others without control characters; jinja escapes it."""
    return printable(value) if type(value) is str else value


def style() -> str:
    """The style sheet of all pages."""
    return _asset("report.css").strip()


def _asset(name: str) -> str:
    return (resources.files("cdrj_ros.report") / "assets" / name).read_text(encoding="utf-8")


PICTURE_BUDGET: Final = 2_700_000
"""Characters available for pictures on one page; channels beyond it are listed but not drawn."""


@dataclass(frozen=True, eq=False)
class RobotShown:
    """Robot, parameters and drawing shown on the page."""

    summary: str
    """The robot and the parameters used, in a sentence or two."""
    robot: Robot | None = None
    """Source of the parameter tables; None leaves them out."""
    drawing: Figure | None = None


@dataclass(frozen=True)
class _Section:
    """One channel of one recording on the page."""

    name: str
    anchor: str
    line: str
    """Error figures in one line."""
    pictures: tuple[Picture, ...]
    left_out: bool
    """Whether pictures were left out although there are samples, to limit the size of the page."""


def write_report(
    path: str | os.PathLike[str],
    errors: Errors,
    *,
    title: str,
    robot: RobotShown,
    versions: Mapping[str, str],
    beside: Beside | None = None,
    limit_check: LimitCheck | None = None,
) -> None:
    """Write the comparisons as one self-contained HTML page, whole or not at all.

    Args:
        path: the file, replaced if it exists.
        errors: the recordings and their figures, in the order of the page.
        title: title of the page, in one line.
        robot: robot and parameters to show.
        versions: names and versions of the software that produced the estimates.
        beside: an additional column of the table, for example published figures.
        limit_check: result of the comparison with limits, if any.

    Raises:
        OSError: the file cannot be written; an existing file is then kept.
    """
    page = template("report.html").render(
        title=title,
        style=style(),
        verdict=verdict(errors),
        limits=_limits(limit_check) if limit_check else None,
        several=len(errors.bags) > 1,
        table=_table(errors.pooled, _anchors(errors.bags), beside),
        bags=_bags(errors),
        robot=robot.summary,
        drawing=drawing_svg(robot.drawing, robot.summary) if robot.drawing else None,
        parameters=parameter_tables(robot.robot) if robot.robot else (),
        versions=versions,
        sigmas=f"{COVERAGE_SIGMAS:g}",
        around=f"{AROUND_NS * 1e-9:g} s",
        back=f"{100.0 * REVERSAL_SHARE:g} %",
        share=f"{100.0 * MINIMUM_SHARE:g} %",
        direction_share=f"{100.0 * DIRECTION_SHARE:g} %",
    )
    write_text(path, page + "\n")


def _limits(limit_check: LimitCheck) -> dict[str, Any]:
    """Verdict on the limits, and the figures outside them."""
    return {
        "kind": "outside" if limit_check.outside else "within",
        "sentence": limits_sentence(limit_check),
        "headings": OUTSIDE_HEADINGS,
        "rows": outside_rows(limit_check),
    }


def _table(
    errors: Mapping[str, ChannelError], anchors: Mapping[str, str], beside: Beside | None = None
) -> dict[str, Any]:
    """The figures, one table per quantity, with names linked to their pictures."""
    groups = table_groups(errors, beside=beside)
    headings = headings_of(errors)
    rows = [
        row
        for group in groups
        for row in (*group.rows, *([group.summary] if group.summary else []))
    ]
    return {
        "groups": groups,
        "headings": headings,
        "many": len(headings) > len(HEADINGS),
        "beside": beside.heading if beside and any(row.aside for row in rows) else None,
        "anchors": anchors,
    }


def _anchor(bag: int, channel: int) -> str:
    return f"bag{bag + 1}-channel{channel + 1}"


def _anchors(bags: Sequence[BagComparison]) -> dict[str, str]:
    """Anchor of the first section of each channel."""
    anchors: dict[str, str] = {}
    for number, bag in enumerate(bags):
        for index, channel in enumerate(bag.channels):
            anchors.setdefault(channel.name, _anchor(number, index))
    return anchors


def _bags(errors: Errors) -> list[dict[str, Any]]:
    """A section per recording."""
    sections = _sections(errors)
    shown = []
    for number, (bag, own) in enumerate(zip(errors.bags, errors.of_bags, strict=True)):
        keys = key_channels([channel.name for channel in bag.channels])
        folded = {
            known.title: [
                sections[number, channel.name]
                for channel in bag.channels
                if quantity_of(channel.name) == quantity and channel.name not in keys
            ]
            for quantity, known in QUANTITIES.items()
        }
        anchors = {name: _anchor(number, index) for index, name in enumerate(own)}
        shown.append(
            {
                "path": bag.path,
                "facts": _facts(bag),
                "notes": bag.notes,
                "health": _health(bag),
                "table": _table(own, anchors) if len(errors.bags) > 1 else None,
                "key": [sections[number, name] for name in keys],
                "friction": _friction(bag, f"bag{number + 1}-friction"),
                "folded": {title: rest for title, rest in folded.items() if rest},
            }
        )
    return shown


def _health(bag: BagComparison) -> dict[str, Any] | None:
    """Verdict of the health monitor and its figures; None if it did not run."""
    if bag.health is None:
        return None
    kind = "outside" if bag.health.alarms else "within"
    return {"kind": kind, "lines": health_lines(bag.health), "values": bag.health.values}


def _sections(errors: Errors) -> dict[tuple[int, str], _Section]:
    """Sections of all channels; the key channels of all recordings use the budget first."""
    from cdrj_ros.report.canvas import Sheets  # imports matplotlib

    budget, sheets = PICTURE_BUDGET, Sheets()
    keys = [key_channels([channel.name for channel in bag.channels]) for bag in errors.bags]
    sections: dict[tuple[int, str], _Section] = {}
    for first in (True, False):
        for number, bag in enumerate(errors.bags):
            label = f"{bag.path}, " if len(errors.bags) > 1 else ""
            for index, channel in enumerate(bag.channels):
                if (channel.name in keys[number]) is not first:
                    continue
                section = _section(
                    channel,
                    errors.of_bags[number].get(channel.name, NO_SAMPLES),
                    _anchor(number, index),
                    origin_of(bag),
                    label,
                    sheets if budget > 0 else None,
                )
                budget -= sum(len(picture.svg) for picture in section.pictures)
                sections[number, channel.name] = section
    return sections


def _section(
    channel: Channel,
    error: ChannelError,
    anchor: str,
    origin_ns: int,
    label_start: str,
    sheets: Sheets | None,
) -> _Section:
    """Section of one channel: name, error figures in one line, and pictures if there are sheets."""
    if error.n == 0:
        return _Section(channel.name, anchor, "no samples", (), left_out=False)
    line = (
        f"mean |error| {format_amount(error.mean_abs_error, channel.unit)}, "
        f"{format_percent(error.mean_relative_error)}; "
        f"largest {format_amount(error.max_abs_error, channel.unit)}; "
        f"R² {format_r2(error.r2)}"
        + (f"; {format_percent(error.coverage, 1)} within ±2σ" if error.coverage else "")
        + (f"; {direction_words(error)}" if channel.is_vector else "")
    )
    if sheets is None:
        return _Section(channel.name, anchor, line, (), left_out=True)
    pictures = channel_pictures(channel, anchor, origin_ns, label_start, sheets)
    return _Section(channel.name, anchor, line, pictures, left_out=False)


def _facts(bag: BagComparison) -> dict[str, str]:
    """Length, facts and counters of one recording."""
    rows = {"length": f"{bag.duration_s:.1f} s", **bag.facts}
    if bag.counters:
        counted = (f"{cause_in_words(cause)}: {n}" for cause, n in bag.counters.items() if n)
        rows["samples left out"] = ", ".join(counted) or "none"
    return rows


def _friction(bag: BagComparison, key: str) -> dict[str, Any] | None:
    """Bars of the pulleys' friction, and the loop of the pulley with the largest mean share."""
    if not bag.friction:
        return None
    most = max(bag.friction, key=lambda one: one.mean_share)
    line = (
        f"most at {most.name}: mean {format_percent(most.mean_share)}, "
        f"{format_amount(most.mean, 'N')}; largest {format_percent(most.largest_share)}"
    )
    return {"line": line, "pictures": friction_pictures(bag.friction, most, key)}


def write_robot_page(
    path: str | os.PathLike[str], inspection: Inspection, suspicions: Sequence[Suspicion]
) -> None:
    """Write one self-contained HTML page on a robot, whole or not at all.

    Args:
        path: the file, replaced if it exists.
        inspection: of ``cdrj_ros.inspection.ranges``.
        suspicions: of ``cdrj_ros.inspection.suspicions``.

    Raises:
        OSError: the file cannot be written; an existing file is then kept.
    """
    from cdrj_ros.report.drawing import draw_robot

    robot = inspection.model.robot
    grave = [entry for entry in suspicions if entry.grave]
    page = template("robot.html").render(
        title=robot.name,
        style=style(),
        headline=headline(inspection),
        verdict=f"{counted(len(grave), 'suspicious value')}" if grave else "nothing suspicious",
        grave=_by_name(grave),
        remarks=_by_name([entry for entry in suspicions if not entry.grave]),
        drawing=drawing_svg(draw_robot(inspection), f"Cables of {robot.name}"),
        cables=cable_tables(inspection),
        parameters=parameter_tables(robot),
    )
    write_text(path, page + "\n")


def _by_name(suspicions: Sequence[Suspicion]) -> dict[str, str]:
    """Texts by the name of what they concern."""
    texts: dict[str, str] = {}
    for entry in suspicions:
        texts[entry.where] = "; ".join(filter(None, (texts.get(entry.where), entry.text)))
    return texts
