"""Results of ``identify``: tables to read, JSON for programs, sections of the robot file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from types import MappingProxyType
from typing import Any, Final, Literal

from cdrj_ros import __version__
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.metrics import ChannelError, pooled_errors
from cdrj_ros.foundation.output import say
from cdrj_ros.identification.fit import Identification
from cdrj_ros.identification.problem import Loss
from cdrj_ros.report.table import print_rows, r2_remark
from cdrj_ros.robot.writer import yaml_number

Section = Literal["fit", "hold_out", "cross_validation"]

HEADINGS: Final[Mapping[Section, str]] = MappingProxyType(
    {
        "fit": "on the bags that were fitted",
        "hold_out": "on bags held out",
        "cross_validation": "on bags left out of the fit",
    }
)


@dataclass(frozen=True)
class Compared:
    """Errors of the estimates on some bags."""

    after: Mapping[str, ChannelError]
    """Errors with the identified numbers, by reference."""
    before: Mapping[str, ChannelError] | None = None
    """Errors with the starting values, by reference."""


@dataclass(frozen=True)
class Outcome:
    """A fit and its errors."""

    found: Identification
    values: Mapping[str, float]
    """Numbers by path as they are written [SI], those of ``--start`` included."""
    bags: tuple[str, ...]
    held_out: tuple[str, ...]
    loss: Loss
    sections: Mapping[Section, Compared]
    folds: tuple[str, ...]
    """A line for each fit of the cross-validation."""
    reading_s: float
    """Time that reading the bags took [s]."""
    fitting_s: float
    """Time that the fit took [s]."""
    posed_from: str = ""
    """Robot file of another pose whose other numbers were kept."""


def print_outcome(outcome: Outcome) -> None:
    """Numbers, notes and errors, as text."""
    found = outcome.found
    _print_numbers(found, outcome.values)
    say(
        f"\n{found.samples} samples, {found.residuals} residuals, {found.evaluations} runs, "
        f"{outcome.reading_s:.1f} s reading, {outcome.fitting_s:.1f} s fitting"
    )
    for section, compared in outcome.sections.items():
        if section == "cross_validation":
            say("\n".join(outcome.folds))
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


def provenance_section(outcome: Outcome) -> str:
    """The entry ``identified`` of the robot file."""
    found = outcome.found
    lines = [
        "identified:                     # origin of the numbers; the estimator does not read it",
        f"  date: {datetime.now(timezone.utc):%Y-%m-%d}",
        f"  tool: cdrj_ros {__version__}",
        *([f"  from: {json.dumps(outcome.posed_from)}"] if outcome.posed_from else []),
        f"  bags: [{', '.join(outcome.bags)}]",
        f"  references: [{', '.join(found.channels)}]",
        f"  loss: {outcome.loss}",
        f"  samples: {found.samples}",
    ]
    if outcome.held_out:
        lines.append(f"  held_out: [{', '.join(outcome.held_out)}]")
    for section, compared in outcome.sections.items():
        lines.append(f"  {section}:")
        lines += [
            f"    {name}: {{rmse: {yaml_number(error.rmse, 4)}"
            + (f", r2: {error.r2:.5f}" if error.r2 is not None else "")
            + "}"
            for name, error in compared.after.items()
            if name in found.channels and error.rmse is not None
        ]
    return "\n".join(lines)


def as_json(outcome: Outcome) -> dict[str, Any]:
    """All printed results in SI units."""
    found = outcome.found
    return {
        "parameters": [
            {
                "paths": list(unknown.paths),
                "factors": list(unknown.factors),
                "start": unknown.start,
                "value": outcome.values[unknown.paths[0]],
                "stddev": float(stddev),
                "lower": unknown.lower,
                "upper": unknown.upper,
            }
            for unknown, stddev in zip(found.unknowns, found.stddev, strict=True)
        ],
        "correlation": found.correlation.tolist(),
        "findings": list(found.findings),
        "references": list(found.channels),
        "samples": found.samples,
        "seconds": outcome.fitting_s,
        "bags": list(outcome.bags),
        **{
            section: {name: vars(error) for name, error in compared.after.items()}
            for section, compared in outcome.sections.items()
        },
    }
