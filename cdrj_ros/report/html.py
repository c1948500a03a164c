"""The report of a comparison, as one self-contained HTML page.

``assets/`` holds Jinja templates, which escape all text; this module provides their values.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any, Final

from jinja2 import Environment, StrictUndefined

from cdrj_ros.evaluation.channels import (
    ANGLE,
    FORCE_VECTOR,
    QUANTITIES,
    BagComparison,
    Channel,
    PulleyFriction,
    quantity_of,
)
from cdrj_ros.evaluation.limits import LimitCheck
from cdrj_ros.evaluation.metrics import (
    COVERAGE_SIGMAS,
    DIRECTION_SHARE,
    MINIMUM_SHARE,
    NO_SAMPLES,
    ChannelError,
    Errors,
    mean_over_channels,
)
from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.output import (
    format_amount,
    format_angle,
    format_percent,
    format_r2,
    printable,
)
from cdrj_ros.foundation.yaml import yaml_text
from cdrj_ros.inspection.ranges import Inspection
from cdrj_ros.model.packing import EFFORT, NODAL_FORCE, TENSION
from cdrj_ros.report.table import (
    HEADINGS,
    OUTSIDE_HEADINGS,
    WORST_ALONE,
    cause_in_words,
    headings_of,
    health_lines,
    limits_sentence,
    outside_rows,
    r2_remark,
    table_groups,
    usable_share,
    worst_channels,
)

PICTURE_BUDGET: Final = 2_700_000
"""Characters available for pictures on one page; channels beyond it are listed but not drawn."""

MOST_OF_A_KIND: Final = 4
"""Largest number of unfolded channels of one kind."""


def write_report(
    path: str | os.PathLike[str],
    errors: Errors,
    *,
    title: str,
    inspection: Inspection,
    versions: Mapping[str, str],
    limit_check: LimitCheck | None = None,
) -> None:
    """Write comparisons as one page, whole or not at all.

    Args:
        path: the file, replaced if it exists.
        errors: the recordings and their figures, in the order of the page.
        title: title of the page, in one line.
        inspection: of the robot whose estimates were compared.
        versions: names and versions of the software that produced the estimates.
        limit_check: result of the comparison with limits, if any.

    Raises:
        OSError: the file cannot be written; an existing file is then kept.
    """
    robot = inspection.model.robot
    page = _template().render(
        title=title,
        style=style(),
        numbers=[*key_numbers(errors.pooled), *_usable(errors.bags)],
        limits=_limits(limit_check) if limit_check else None,
        several=len(errors.bags) > 1,
        table=_table(errors.pooled, _anchors(errors.bags)),
        bags=_bags(errors),
        robot=f"{robot.name} ({robot.source})",
        drawing=_drawing(inspection),
        parameters=yaml_text(dict(robot.document)).splitlines(),
        versions=versions,
        sigmas=f"{COVERAGE_SIGMAS:g}",
        share=f"{100.0 * MINIMUM_SHARE:g} %",
        direction_share=f"{100.0 * DIRECTION_SHARE:g} %",
    )
    write_text(path, page + "\n")


def _template() -> Any:
    """The page as a template that escapes all text."""
    environment = Environment(
        autoescape=True,
        finalize=lambda value: printable(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.from_string(_asset("report.html"))


def style() -> str:
    """The style sheet of the page."""
    return _asset("report.css").strip()


def _asset(name: str) -> str:
    return (resources.files("cdrj_ros.report") / "assets" / name).read_text(encoding="utf-8")


def _drawing(inspection: Inspection) -> Any:
    """The drawing of the robot."""
    from cdrj_ros.report.drawing import draw_robot
    from cdrj_ros.report.figures import inline_svg

    name = inspection.model.robot.name
    return inline_svg(draw_robot(inspection), f"Cables of {name}", "drawing")


def _limits(limit_check: LimitCheck) -> dict[str, Any]:
    """Verdict on the limits, and the figures outside them."""
    return {
        "kind": "outside" if limit_check.outside else "within",
        "sentence": limits_sentence(limit_check),
        "headings": OUTSIDE_HEADINGS,
        "rows": outside_rows(limit_check),
    }


def key_numbers(errors: Mapping[str, ChannelError]) -> list[dict[str, str]]:
    """One number for every quantity and unit, in large type: label, value, meaning and detail."""
    alike: dict[tuple[str, str], list[ChannelError]] = {}
    for quantity, known in QUANTITIES.items():
        for name, error in errors.items():
            if quantity_of(name) == quantity and error.n:
                alike.setdefault((quantity, error.unit or known.unit), []).append(error)
    numbers = []
    for (quantity, unit), members in alike.items():
        known, overall = QUANTITIES[quantity], mean_over_channels(members)
        mean, largest = (
            format_amount(value, unit) for value in (overall.mean_abs_error, overall.max_abs_error)
        )
        value, meaning = format_percent(overall.mean_relative_error), "mean relative error"
        if known.signed or overall.mean_relative_error is None:
            value, meaning = mean, "mean error"
        covered = (
            f"; {format_percent(overall.coverage)} in ±2σ" if overall.coverage is not None else ""
        )
        detail = f"{mean} mean, {largest} largest{covered}{_direction(overall)}"
        label = known.title if len(members) == 1 else f"{len(members)} {known.several}"
        numbers.append({"label": label, "value": value, "meaning": meaning, "detail": detail})
    return numbers


def _usable(bags: Sequence[BagComparison]) -> list[dict[str, str]]:
    """The share of estimates with status OK, as another of the ``key_numbers``, if it is known."""
    share = usable_share(bags)
    if share is None:
        return []
    return [
        {
            "label": "Status OK",
            "value": format_percent(share),
            "meaning": "of the estimated tensions",
            "detail": "the others have a flag, most of a new robot UNSURE",
        }
    ]


def _direction(error: ChannelError) -> str:
    """Mean and largest direction error of vectors."""
    if error.mean_direction_error_deg is None:
        return ""
    return (
        f"; direction {format_angle(error.mean_direction_error_deg)} mean, "
        f"{format_angle(error.max_direction_error_deg)} largest"
    )


def _table(errors: Mapping[str, ChannelError], anchors: Mapping[str, str]) -> dict[str, Any]:
    """The figures, one table per quantity, with names linked to their pictures."""
    headings, shown = headings_of(errors), worst_channels(errors)
    return {
        "groups": table_groups(errors, shown),
        "every": table_groups(errors) if shown else (),
        "caption": f"{WORST_ALONE[0].upper()}{WORST_ALONE[1:]}." if shown else "",
        "headings": headings,
        "many": len(headings) > len(HEADINGS),
        "anchors": anchors,
        "remark": r2_remark(errors),
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


def key_channels(names: Sequence[str]) -> list[str]:
    """The most informative channels, in display order, at most MOST_OF_A_KIND of each kind.

    The tension of a cable's last element contains the friction of all its pulleys. The force at
    node 3 is the one measured in the paper; for a cable without it, the last node is chosen.
    """
    chosen: list[str] = []
    for quantity in (TENSION, NODAL_FORCE, FORCE_VECTOR, EFFORT, ANGLE):
        own: dict[str, tuple[tuple[bool, int], str]] = {}
        for name in (one for one in names if quantity_of(one) == quantity):
            part, _, number = name.rpartition("/")
            if quantity in (EFFORT, ANGLE) or not number.isdecimal():
                own[name] = ((False, 0), name)
                continue
            rank = (quantity != TENSION and int(number) == 3, int(number))
            own[part] = max(own.get(part, ((False, -1), "")), (rank, name))
        chosen += [name for _, name in own.values()][:MOST_OF_A_KIND]
    return chosen or list(names[:MOST_OF_A_KIND])


def _bags(errors: Errors) -> list[dict[str, Any]]:
    """A section per recording, with its channels by quantity; the key channels are not folded."""
    sections = _sections(errors)
    shown = []
    for number, (bag, own) in enumerate(zip(errors.bags, errors.of_bags, strict=True)):
        keys = key_channels([channel.name for channel in bag.channels])
        folded: dict[str, list[dict[str, Any]]] = {}
        for name in (one.name for one in bag.channels if one.name not in keys):
            title = QUANTITIES[quantity_of(name)].title
            folded.setdefault(title, []).append(sections[number, name])
        anchors = {name: _anchor(number, index) for index, name in enumerate(own)}
        shown.append(
            {
                "path": bag.path,
                "facts": _facts(bag),
                "notes": bag.notes,
                "health": _health(bag),
                "table": _table(own, anchors) if len(errors.bags) > 1 else None,
                "key": [sections[number, name] for name in keys],
                "friction": [_friction_row(one) for one in bag.friction],
                "folded": folded,
            }
        )
    return shown


def _health(bag: BagComparison) -> dict[str, Any] | None:
    """What the sensors say about the robot, and their figures; None if none was heard."""
    if bag.health is None:
        return None
    kind = "outside" if bag.health.alarms else "within"
    return {"kind": kind, "lines": health_lines(bag.health), "values": bag.health.values}


def _sections(errors: Errors) -> dict[tuple[int, str], dict[str, Any]]:
    """Sections of all channels; the key channels of all recordings use the budget first.

    Only key channels are drawn in detail.
    """
    from cdrj_ros.report.figures import channel_pictures

    budget = PICTURE_BUDGET
    keys = [key_channels([channel.name for channel in bag.channels]) for bag in errors.bags]
    sections: dict[tuple[int, str], dict[str, Any]] = {}
    for first in (True, False):
        for number, bag in enumerate(errors.bags):
            stamps = [int(one.stamp_ns[0]) for one in bag.channels if len(one.stamp_ns)]
            for index, channel in enumerate(bag.channels):
                if (channel.name in keys[number]) is not first:
                    continue
                error = errors.of_bags[number].get(channel.name, NO_SAMPLES)
                anchor, pictures = _anchor(number, index), []
                if error.n and budget > 0:
                    label = f"{bag.path}, {channel.name}"
                    origin_ns = min(stamps)
                    pictures = channel_pictures(channel, anchor, origin_ns, label, closer=first)
                    budget -= sum(len(picture.svg) for picture in pictures)
                sections[number, channel.name] = {
                    "name": channel.name,
                    "anchor": anchor,
                    "line": _line(channel, error),
                    "pictures": pictures,
                    "left_out": bool(error.n and not pictures),
                }
    return sections


def _line(channel: Channel, error: ChannelError) -> str:
    """Error figures of one channel in one line."""
    if not error.n:
        return "no samples"
    return (
        f"mean |error| {format_amount(error.mean_abs_error, channel.unit)}, "
        f"{format_percent(error.mean_relative_error)}; "
        f"largest {format_amount(error.max_abs_error, channel.unit)}; "
        f"R² {format_r2(error.r2)}"
        + (f"; {format_percent(error.coverage, 1)} within ±2σ" if error.coverage else "")
        + _direction(error)
    )


def _facts(bag: BagComparison) -> dict[str, str]:
    """Length, facts and counters of one recording."""
    rows = {"length": f"{bag.duration_s:.1f} s", **bag.facts}
    if bag.counters:
        causes = (f"{cause_in_words(cause)}: {n}" for cause, n in bag.counters.items() if n)
        rows["samples left out"] = ", ".join(causes) or "none"
    return rows


def _friction_row(one: PulleyFriction) -> tuple[str, ...]:
    """Friction of one pulley, as a force and as a share of the larger tension."""
    shares = (format_percent(share) for share in (one.mean_share, one.largest_share))
    return (one.name, format_amount(one.mean, "N"), format_amount(one.largest, "N"), *shares)
