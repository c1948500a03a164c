"""Results of ``identify``: tables to read, JSON for programs, sections of the robot file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import __version__
from cdrj_ros.identification.fit import Identification
from cdrj_ros.identification.solution import Loss
from cdrj_ros.judgement.channels import BagComparison
from cdrj_ros.judgement.metrics import ChannelError, pooled_errors
from cdrj_ros.robot.writer import yaml_number

COVARIANCE_LIMIT: Final = 64
"""Parameters whose covariance a robot file can hold."""

Section = Literal["fit", "hold_out", "cross_validation"]

HEADINGS: Final[Mapping[Section, str]] = MappingProxyType(
    {
        "fit": "on the bags that were fitted",
        "hold_out": "on bags held out",
        "cross_validation": "of fits that had not seen the bag",
    }
)


@dataclass(frozen=True)
class Compared:
    """Errors of the estimates on some bags."""

    after: Mapping[str, ChannelError]
    """With the numbers found, by reference."""
    before: Mapping[str, ChannelError] | None = None
    """With the numbers of the start."""


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


def print_outcome(outcome: Outcome) -> None:
    """Numbers, notes and errors, as text."""
    found = outcome.found
    _print_numbers(found, outcome.values)
    print(
        f"\n{found.samples} samples, {found.residuals} residuals, {found.evaluations} runs, "
        f"{outcome.reading_s:.1f} s reading, {outcome.fitting_s:.1f} s fitting"
    )
    for section, compared in outcome.sections.items():
        if section == "cross_validation":
            print("\n".join(outcome.folds))
        _print_errors(HEADINGS[section], compared, found.channels)


def fold_line(pattern: str, judged: Sequence[BagComparison], fitted: Sequence[str]) -> str:
    """Errors on the bags that a fit of the cross-validation left out."""
    return f"without {pattern}: " + ", ".join(
        f"{name} RMSE {error.rmse:.4g} R² {error.r2:.4f}"
        for name, error in pooled_errors(judged).items()
        if name in fitted and error.rmse is not None and error.r2 is not None
    )


def _print_numbers(found: Identification, values: Mapping[str, float]) -> None:
    width = max(len(unknown.name) for unknown in found.unknowns)
    print(f"{'parameter':{width}s} {'start':>12s} {'found':>12s} {'stddev':>10s}")
    for unknown, stddev in zip(found.unknowns, found.stddev, strict=True):
        value = values[unknown.paths[0]]
        print(f"{unknown.name:{width}s} {unknown.start:12.6g} {value:12.6g} {stddev:10.2g}")
    for sentence in found.findings:
        print(f"note: {sentence}")


def _print_errors(title: str, compared: Compared, fitted: Sequence[str]) -> None:
    errors, old = compared.after, compared.before or {}
    width = max(len(name) for name in errors)
    print(f"\nerrors {title}{' (in brackets: before)' if old else ''}")
    print(f"{'reference':{width}s} {'RMSE':>22s} {'mean rel. error':>22s} {'R²':>20s}")
    for name, error in errors.items():
        cells = [
            _beside(error, old.get(name), "rmse", ".4g"),
            _beside(error, old.get(name), "mean_relative_error", ".2%"),
            _beside(error, old.get(name), "r2", ".5f"),
        ]
        mark = "" if name in fitted else "  (not fitted)"
        print(f"{name:{width}s} {cells[0]:>22s} {cells[1]:>22s} {cells[2]:>20s}{mark}")


def _beside(error: ChannelError, old: ChannelError | None, figure: str, form: str) -> str:
    def shown(one: ChannelError | None) -> str:
        value = getattr(one, figure) if one is not None else None
        return "–" if value is None else format(value, form)

    return shown(error) + (f" ({shown(old)})" if old is not None else "")


def _expanded(found: Identification) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    """Paths, standard deviations and correlation of all places, tied ones included."""
    paths = [path for unknown in found.unknowns for path in unknown.paths]
    signs = np.array([sign for unknown in found.unknowns for sign in unknown.signs], dtype=float)
    which = np.repeat(
        np.arange(len(found.unknowns)), [len(unknown.paths) for unknown in found.unknowns]
    )
    correlation = found.correlation[np.ix_(which, which)] * np.outer(signs, signs)
    return paths, found.stddev[which], correlation


def uncertainty_section(found: Identification) -> str | None:
    """The entry ``uncertainty`` of the robot file; None where there are too many numbers."""
    paths, stddev, correlation = _expanded(found)
    if len(paths) > COVARIANCE_LIMIT:
        return None
    lines = ["uncertainty:                    # standard deviations and correlations of the fit"]
    lines.append("  parameters:")
    lines += [f"    - {path}" for path in paths]
    lines.append(f"  stddev: [{', '.join(yaml_number(float(s), 3) for s in stddev)}]")
    lines.append("  correlation:")
    lines += [
        "    - [" + ", ".join(f"{value:.4f}".rstrip("0").rstrip(".") for value in row) + "]"
        for row in correlation
    ]
    return "\n".join(lines)


def provenance_section(outcome: Outcome) -> str:
    """The entry ``identified`` of the robot file."""
    found = outcome.found
    lines = [
        "identified:                     # where the numbers come from; not read",
        f"  date: {datetime.now(timezone.utc):%Y-%m-%d}",
        f"  tool: cdrj_ros {__version__}",
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
                "signs": list(unknown.signs),
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
