"""Shared by the commands: options, topics, results and their JSON file.

The file is ``{"format", "version", "bags": [{"path", "duration_s", "channels", "friction",
"counters", "notes", "facts", "health"}], "all": {"channels"}, "limits"}`` where ``channels`` maps a
channel's name to its ``unit``, ``n`` and the figures of ChannelError, ``friction`` a pulley's name
to the figures of PulleyFriction, ``health`` is null or the verdict of the sensors, and
``limits`` is null or ``{"file", "checked", "outside": [{"where", "channel", "figure", "value",
"min" or "max", "by"}]}``.  An unknown figure is null; NaN and infinity never appear.
docs/recordings.md describes every key.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Mapping
from typing import Any, Final

from cdrj_ros import __version__
from cdrj_ros.evaluation.channels import unit_of
from cdrj_ros.evaluation.comparison import DROP_CAUSES
from cdrj_ros.evaluation.limits import LimitCheck
from cdrj_ros.evaluation.metrics import ChannelError, Errors
from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.output import Json, json_text, plain, say
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.table import Columns
from cdrj_ros.robot.document import read_text, yaml_mapping


def add_robot_option(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """``--robot FILE``, ``--preload N,N,...``; ``several``: the latter once for every bag."""
    parser.add_argument("--robot", required=True, metavar="FILE", help="robot file (YAML)")
    each = "; given once, or once for each bag in order" if several else ""
    parser.add_argument(
        "--preload", metavar="N,N,...", action="append" if several else "store",
        help="preload of every cable [N], in the robot file's order (default: the file's)" + each,
    )  # fmt: skip


def add_topic_options(parser: argparse.ArgumentParser) -> None:
    """``--motor-topic``, ``--joint-topic``, ``--reference``, ``--topic-prefix``."""
    defaults = Topics()
    parser.add_argument(
        "--motor-topic", metavar="TOPIC",
        help=f"JointState with the motor angles (default {defaults.motors})",
    )  # fmt: skip
    parser.add_argument(
        "--joint-topic", metavar="TOPIC",
        help=f"JointState with the joint angles (default {defaults.joints})",
    )  # fmt: skip
    parser.add_argument(
        "--reference", action="append", metavar="TOPIC",
        help="recorded references: CableTensions, NodalForces, or JointState with efforts; "
        f"repeatable (default {', '.join(defaults.references)})",
    )  # fmt: skip
    parser.add_argument(
        "--topic-prefix", default="", metavar="NAMESPACE",
        help="prefix of every default topic: /left for /left/cdrj/motor_states, ...",
    )  # fmt: skip


def add_result_options(parser: argparse.ArgumentParser) -> None:
    """``--json``, ``--html``."""
    parser.add_argument("--json", metavar="FILE", help="write the errors as JSON")
    parser.add_argument("--html", metavar="FILE", help="write a report with pictures")


def topic_prefix(arguments: argparse.Namespace) -> str:
    """Prefix of the default topics: empty, or with a leading slash and no trailing one."""
    prefix = str(arguments.topic_prefix).strip("/")
    return f"/{prefix}" if prefix else ""


def add_channel_options(parser: argparse.ArgumentParser) -> None:
    """The options of topics and, to read a table instead, ``--columns``."""
    add_topic_options(parser)
    parser.add_argument(
        "--columns", metavar="FILE",
        help="read tables (CSV) instead of bags, whose columns this file names (YAML, "
        "docs/tables.md)",
    )  # fmt: skip


def channels_of(arguments: argparse.Namespace) -> Topics | Columns:
    """Where the channels are: the columns of a table if ``--columns`` is given, or the topics.

    Raises:
        UsageError, RobotFileError: the file of columns cannot be read or is wrong.
    """
    path = arguments.columns
    if path is None:
        return topics_of(arguments)
    what = "the columns of a table"
    return Columns.of(yaml_mapping(read_text(path, "file of columns"), path, what), path)


def topics_of(arguments: argparse.Namespace) -> Topics:
    """The topics that the options name."""
    defaults = Topics()
    prefix = topic_prefix(arguments)
    references = arguments.reference
    return Topics(
        arguments.motor_topic or prefix + defaults.motors,
        arguments.joint_topic or prefix + defaults.joints,
        tuple(references or (prefix + topic for topic in defaults.references)),
    )


def versions() -> dict[str, str]:
    """Versions of the software that produced the results."""
    from importlib import metadata  # slow, and only reports need it

    named = {"cdrj_ros": __version__, "Python": platform.python_version()}
    for package in ("numpy", "scipy", "rosbags", "mcap"):
        named[package] = metadata.version(package)
    return named


def write_files(
    arguments: argparse.Namespace,
    model: Model,
    errors: Errors,
    title: str,
    limit_check: LimitCheck | None = None,
) -> None:
    """Write the files given by ``--json`` and ``--html``.

    Args:
        arguments: with ``json`` and ``html``.
        model: the prepared robot.
        errors: the recordings and their figures.
        title: of the report.
        limit_check: result of comparing with limits, where there were any.
    """
    if arguments.json:
        write_results(arguments.json, errors, limit_check)
    if arguments.html:
        from cdrj_ros.inspection.ranges import inspect_robot
        from cdrj_ros.report.html import write_report

        write_report(
            arguments.html,
            errors,
            title=title,
            inspection=inspect_robot(model),
            versions=versions(),
            limit_check=limit_check,
        )


def print_results(
    arguments: argparse.Namespace,
    errors: Errors,
    title: str,
    limit_check: LimitCheck | None = None,
    *,
    every: bool = True,
) -> None:
    """Print notes, counters and the table, then the names of the files; arguments as above.

    With ``every`` all channels are printed, even where they are more than a screen holds.
    """
    from cdrj_ros.report.table import print_errors, print_limits, status_lines

    for bag in errors.bags:
        for note in bag.notes:
            say(f"note: {bag.path}: {note}")
        for cause, count in bag.counters.items():
            if count and cause in DROP_CAUSES:
                say(f"left out: {bag.path}: {count} {DROP_CAUSES[cause]}")
            elif count:
                words = cause.replace("_", " ")
                say(f"readings: {bag.path}: {count} {words} (docs/estimation.md)")
    print_errors(errors.pooled, title=title, every=every)
    for line in status_lines(errors.bags):
        say(line)
    if limit_check:
        print_limits(limit_check)
    if arguments.json:
        say(f"figures: {arguments.json}")
    if arguments.html:
        say(f"report: {arguments.html}")


FORMAT: Final = "cdrj_ros/validation"
VERSION: Final = 3
"""Incremented when a key changes its meaning or is removed, but not for new keys."""


def results(errors: Errors, limit_check: LimitCheck | None = None) -> Json:
    """Content of the file written by ``write_results``, as plain lists and dictionaries.

    ``all`` holds the figures of the pooled samples of all recordings.
    """
    bags = [
        {
            "path": bag.path,
            "duration_s": bag.duration_s,
            "channels": _channels(own),
            "friction": {one.name: _without(vars(one), "name") for one in bag.friction},
            "counters": bag.counters,
            "notes": bag.notes,
            "facts": bag.facts,
            "health": bag.health,
        }
        for bag, own in zip(errors.bags, errors.of_bags, strict=True)
    ]
    limits = None
    if limit_check is not None:
        outside = [
            {
                **_without(vars(one), "least", "bound", "unit"),
                "min" if one.least else "max": one.bound,
                "by": one.by,
            }
            for one in limit_check.outside
        ]
        limits = {**vars(limit_check), "outside": outside}
        limits["file"] = limits.pop("source")
    return plain(
        {
            "format": FORMAT,
            "version": VERSION,
            "bags": bags,
            "all": {"channels": _channels(errors.pooled)},
            "limits": limits,
        }
    )


def write_results(
    path: str | os.PathLike[str], errors: Errors, limit_check: LimitCheck | None = None
) -> None:
    """Write the figures as JSON atomically.

    Raises:
        OSError: the file cannot be written; an existing file is then kept.
    """
    write_text(path, json_text(results(errors, limit_check)))


def _channels(errors: Mapping[str, ChannelError]) -> dict[str, dict[str, Any]]:
    return {
        name: {**vars(error), "unit": error.unit or unit_of(name)} for name, error in errors.items()
    }


def _without(entries: dict[str, Any], *names: str) -> dict[str, Any]:
    return {name: value for name, value in entries.items() if name not in names}
