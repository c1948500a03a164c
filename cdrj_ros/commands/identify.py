"""``identify``: numbers of the robot file from bags, with standard errors and hold-out figures."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Final, Literal, NamedTuple

from cdrj_ros import __version__
from cdrj_ros.commands.entry import DONE, run_command
from cdrj_ros.commands.identify_entries import model_errors, with_residuals
from cdrj_ros.commands.identify_task import Task, parser, posed, task_of
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.inputs import (
    condition_recording,
    doubts_of,
    read_inputs,
    require_references,
)
from cdrj_ros.evaluation.metrics import ChannelError, pooled_errors
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.output import ProgressBar, printable, say
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.identification.entries import (
    COVARIANCE_LIMIT,
    fit_errors,
    fitted_numbers,
    uncertainty_section,
)
from cdrj_ros.identification.fit import Identification, identify
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.priors import Moved, pose_ranges
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.table import Columns
from cdrj_ros.report.table import print_rows, r2_remark
from cdrj_ros.robot.document import parse_document
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, parse_robot
from cdrj_ros.robot.writer import moved, with_numbers_in_text, with_section, yaml_number

Section = Literal["fit", "hold_out", "cross_validation"]

HEADINGS: Final[Mapping[Section, str]] = MappingProxyType(
    {
        "fit": "on the bags that were fitted",
        "hold_out": "on bags held out",
        "cross_validation": "on bags left out of the fit",
    }
)


class Compared(NamedTuple):
    """Errors of the estimates on some bags."""

    after: Mapping[str, ChannelError]
    """Errors with the identified numbers, by reference."""
    before: Mapping[str, ChannelError] | None = None
    """Errors with the starting values, by reference."""


Sections = Mapping[Section, Compared]


def print_outcome(
    found: Identification, values: Mapping[str, float], times: str, sections: Sections,
    folds: Sequence[str],
) -> None:  # fmt: skip
    """Numbers, notes and errors, as text."""
    _print_numbers(found, values)
    say(
        f"\n{found.samples} samples, {found.residuals} residuals, {found.evaluations} runs, {times}"
    )
    for section, compared in sections.items():
        if section == "cross_validation":
            say("\n".join(folds))
        _print_errors(HEADINGS[section], compared, found.channels)


def fold_line(pattern: str, judged: Sequence[BagComparison], fitted: Sequence[str]) -> str:
    """Errors on the bags that a fit of the cross-validation left out."""
    return f"without {pattern}: " + ", ".join(
        f"{name} RMSE {error.rmse:.4g} R² {error.r2:.4f}"
        for name, error in pooled_errors(judged).items()
        if name in fitted and error.rmse is not None and error.r2 is not None
    )


def _print_numbers(found: Identification, values: Mapping[str, float]) -> None:
    rows = [
        (unknown.name, f"{unknown.start:.6g}", f"{values[unknown.paths[0]]:.6g}", f"{stddev:.2g}")
        for unknown, stddev in zip(found.unknowns, found.stddev, strict=True)
    ]
    print_rows(("parameter", "start", "found", "stddev"), rows, right=True)
    for sentence in found.findings:
        say(f"note: {sentence}")


def _print_errors(title: str, compared: Compared, fitted: Sequence[str]) -> None:
    old = compared.before or {}
    say(f"\nerrors {title}{' (in brackets: with the starting values)' if old else ''}")
    rows = [
        (
            name,
            _beside(error, old.get(name), "rmse", ".4g"),
            _beside(error, old.get(name), "mean_relative_error", ".2%"),
            _beside(error, old.get(name), "r2", ".5f"),
            "" if name in fitted else "not fitted",
        )
        for name, error in compared.after.items()
    ]
    print_rows(("reference", "RMSE", "mean rel. error", "R²", ""), rows, right=True)
    if remark := r2_remark(compared.after):
        say(remark)


def _beside(error: ChannelError, old: ChannelError | None, figure: str, form: str) -> str:
    def shown(one: ChannelError | None) -> str:
        value = getattr(one, figure) if one is not None else None
        return "–" if value is None else format(value, form)

    return shown(error) + (f" ({shown(old)})" if old is not None else "")


def provenance_section(task: Task, found: Identification, sections: Sections) -> str:
    """The entry ``identified`` of the robot file."""
    bags, held_out = (
        ", ".join(Path(bag).name for bag in some) for some in (task.bags, task.held_out)
    )
    lines = [
        "identified:                     # origin of the numbers; the estimator does not read it",
        f"  date: {datetime.now(timezone.utc):%Y-%m-%d}",
        f"  tool: cdrj_ros {__version__}",
        *([f"  from: {json.dumps(task.path.name)}"] if task.pose else []),
        f"  bags: [{bags}]",
        f"  references: [{', '.join(found.channels)}]",
        f"  loss: {task.settings.loss}",
        f"  samples: {found.samples}",
        *([f"  held_out: [{held_out}]"] if held_out else []),
    ]
    for section, compared in sections.items():
        lines.append(f"  {section}:")
        lines += [
            f"    {name}: {{rmse: {yaml_number(error.rmse, 4)}"
            + (f", r2: {error.r2:.5f}" if error.r2 is not None else "")
            + "}"
            for name, error in compared.after.items()
            if name in found.channels and error.rmse is not None
        ]
    return "\n".join(lines)


def _body(argv: Sequence[str]) -> int:
    arguments = parser().parse_args(argv)
    task = task_of(arguments)
    if not task.unknowns:
        return _corrected(arguments, task)
    return _identified(arguments, task)


def _corrected(arguments: argparse.Namespace, task: Task) -> int:
    """Learn corrections of a robot file whose numbers stay, and write it."""
    text = _text_with(task, task.start)
    recordings = _read(task.bags, task.topics, prepare(parse_robot(text, task.source)))
    text = with_residuals(text, task, recordings)
    if arguments.out:
        _write(arguments.out, text, task)
        say(f"robot file: {arguments.out}")
    return DONE


def _text_with(task: Task, values: Mapping[str, float]) -> str:
    """The robot file's text with other numbers, without the corrections of the old ones."""
    text = with_section(task.path.read_text(encoding="utf-8"), "residual", None)
    return with_numbers_in_text(text, values, task.source)


def _identified(arguments: argparse.Namespace, task: Task) -> int:
    """Fit, compare with the bags, write and print."""
    begin = perf_counter()
    model = prepare(build_robot(task.document, task.source))
    recordings = _read(task.bags, task.topics, model)
    left: Moved = {}
    if task.pose:
        task, left = posed(arguments, task, recordings)
        model = prepare(build_robot(task.document, task.source))
    read = perf_counter()
    found = fit(task.document, task.source, task.unknowns, recordings, task.settings)
    values = {**task.start, **{path: _round(one) for path, one in found.by_path.items()}}
    values |= {path: _round(end) for path, end in pose_ranges(left, values).items()}
    seen = {path for k in found.seen.tolist() for path in found.unknowns[k].paths}
    written = {path: values[path] for path in values if path in seen or path in task.start}
    text = _text_with(task, written)
    fitted = prepare(parse_robot(text, task.source))
    times = f"{read - begin:.1f} s reading, {perf_counter() - read:.1f} s fitting"
    both = [validated(task.bags, task.topics, one) for one in (fitted, model)]
    sections: dict[Section, Compared] = {"fit": Compared(*map(pooled_errors, both))}
    unseen: list[BagComparison] = []
    if task.held_out:
        both = [validated(task.held_out, task.topics, one) for one in (fitted, model)]
        sections["hold_out"] = Compared(*map(pooled_errors, both))
        unseen += both[0]
    fold_lines: tuple[str, ...] = ()
    if task.folds:
        judged, fold_lines = cross_validated(task, found, recordings)
        sections["cross_validation"] = Compared(pooled_errors(judged))
        unseen += judged
    text = _with_uncertainty(text, task, found, unseen)
    if arguments.residual:
        text = with_residuals(text, task, recordings)
    if arguments.out:  # before anything is printed: standard output may be closed
        origin = provenance_section(task, found, sections)
        _write(arguments.out, with_section(text, "identified", origin), task)
    print_outcome(found, values, times, sections, fold_lines)
    if arguments.out and len(found.by_path) > COVARIANCE_LIMIT:
        print(f"note: more than {COVARIANCE_LIMIT} numbers; their covariance is not written")
    if arguments.out:
        say(f"robot file: {arguments.out}")
    return DONE


def fit(
    document: Document,
    source: str,
    unknowns: Sequence[Unknown],
    recordings: Sequence[Recorded],
    settings: Settings,
) -> Identification:
    """``identify``, with its progress on standard error."""
    with ProgressBar("fitting") as progress:
        return identify(document, source, unknowns, recordings, settings, partial(progress, 0.0))


def cross_validated(
    task: Task, found: Identification, recordings: Sequence[Recorded]
) -> tuple[list[BagComparison], tuple[str, ...]]:
    """Compare every bag with the estimates of a fit without this bag.

    Returns:
        The comparisons, and a line for each fit.
    """
    unseen: list[BagComparison] = []
    lines = []
    settings = task.settings
    rough = Settings(
        found.channels, settings.weights, settings.loss, settings.settle_s, coarse=True
    )  # fmt: skip
    begin = with_numbers(task.document, found.by_path)
    again = [replace(u, start=float(v)) for u, v in zip(found.unknowns, found.values, strict=True)]
    for pattern, out in task.folds.items():
        others = [one for k, one in enumerate(recordings) if k not in out]
        fold = fit(begin, task.source, again, others, rough)
        robot = build_robot(with_numbers(task.document, fold.by_path), task.source)
        judged = validated([task.bags[k] for k in out], task.topics, prepare(robot))
        unseen += judged
        lines.append(fold_line(pattern, judged, found.channels))
    return unseen, tuple(lines)


def validated(bags: Sequence[str], topics: Topics | Columns, model: Model) -> list[BagComparison]:
    """The comparisons that ``validate`` makes."""
    return [validate_bag(model, bag, topics) for bag in bags]


def _read(bags: Sequence[str], topics: Topics | Columns, model: Model) -> list[Recorded]:
    recordings, notes = [], list[str]()
    with ProgressBar("reading", len(bags)) as report:
        for bag in bags:
            read = read_inputs(bag, topics, model)
            require_references(bag, topics, read)
            name = Path(bag).name
            recordings.append(Recorded(name, read.motors, read.joints, read.references))
            doubts = doubts_of(model, condition_recording(model, read))
            notes += [f"{name}: {note}" for note in (*read.notes, *doubts)]
            report(len(recordings))
    for note in notes:
        print(printable(note))
    return recordings


def _round(value: float) -> float:
    """The number with the digits that are written."""
    return float(yaml_number(value))


def _with_uncertainty(
    text: str, task: Task, found: Identification, unseen: Sequence[BagComparison]
) -> str:
    """The robot file's text with the block ``uncertainty``."""
    stated = dict(task.document.get("uncertainty", {}))

    def section(errors: Mapping[str, float]) -> str:
        numbers = fitted_numbers(found, stated)
        entry = uncertainty_section(numbers, stated, errors, found.drums, unseen=bool(unseen))
        return with_section(text, "uncertainty", entry)

    if not unseen:
        return section(fit_errors(found))
    stated.pop("model_error", None)
    model = prepare(parse_robot(section({}), task.source))
    return section(model_errors(model, unseen, task.topics, found.channels))


def _write(out: str, text: str, task: Task) -> None:
    """Write a robot file that may be in another folder than the one that it comes from."""
    text = moved(text, task.source, out)
    parse_document(text, out)
    write_text(out, text)


main = partial(run_command, "identify", _body)
"""Entry point; returns the exit code."""
