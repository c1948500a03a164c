"""The entry ``uncertainty`` of the robot file after a fit."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Table
from cdrj_ros.identification.alternatives import DrumFinding
from cdrj_ros.identification.fit import Identification
from cdrj_ros.robot.stated import (
    StatedNumbers,
    related,
    stated_numbers,
    with_covariance,
)
from cdrj_ros.robot.writer import yaml_number

KINDS: Final = ("effort/", "tension/")
"""Channels for which a robot file can state the model's error."""

COVARIANCE_LIMIT: Final = 128
"""Parameters whose covariance a robot file can hold."""

NOTICEABLE: Final = 0.02
"""Correlation with a fitted number from which a number that was not fitted is written."""


def uncertainty_section(
    numbers: StatedNumbers,
    before: Mapping[str, Any],
    errors: Mapping[str, float],
    drums: Mapping[str, DrumFinding],
    *,
    unseen: bool = False,
) -> str:
    """The entry ``uncertainty`` of the robot file.

    Args:
        numbers: what is known of numbers.
        before: the same entry before the fit; what it states about drums is kept.
        errors: errors of the model by channel; if empty, those of ``before`` are kept.
        drums: what was found of cables on their drums.
        unseen: whether the errors are from recordings that were not fitted.
    """
    lines = ["uncertainty:                    # standard deviations and correlations"]
    if "others" in before:
        lines.append(f"  others: {before['others']}")
    lines += drum_lines(before, drums)
    origin = "runs that were not fitted" if unseen else "the residuals of the fit"
    if stated := dict(errors) or dict(before.get("model_error", {})):
        lines.append(f"  model_error:                  # from {origin if errors else 'before'}")
        lines += [f"    {name}: {yaml_number(value, 3)}" for name, value in stated.items()]
    lines += stated_lines(numbers)
    return "\n".join(lines) if len(lines) > 1 else "uncertainty: {}"


def drum_lines(before: Mapping[str, Any], found: Mapping[str, DrumFinding]) -> list[str]:
    """The lines of ``drums``, by cable where it is not the same of all.

    Args:
        before: the entry ``uncertainty``.
        found: of all cables that may slip by this entry; none if they were not judged.
    """
    stated = before.get("drums")
    words = stated if isinstance(stated, Mapping) else {}
    lines = {name: f"{one.drums}  # {one.comment}" for name, one in found.items()}
    of_all = {one.drums for one in found.values()}
    if of_all == {"hold"} or (len(of_all) == 1 and not words):
        return [f"  drums: {next(iter(lines.values()))}"]
    if words or lines:
        return ["  drums:", *(f"    {name}: {word}" for name, word in {**words, **lines}.items())]
    return [f"  drums: {stated}"] if stated else []


def fitted_numbers(
    found: Identification, before: Mapping[str, Any], elsewhere: Collection[str] = ()
) -> StatedNumbers:
    """What is known of numbers after a fit; of none if more than ``COVARIANCE_LIMIT`` were fitted.

    Args:
        found: the fit.
        before: the entry ``uncertainty`` before it; what it states about other numbers is kept.
        elsewhere: numbers that are left out, as another fit shows them.
    """
    fitted = _of_the_fit(found)
    kept = stated_numbers(before)
    gone = {*fitted.paths, *elsewhere}
    kept = kept.part([k for k, path in enumerate(kept.paths) if path not in gone])
    if not 0 < len(fitted.paths) <= COVARIANCE_LIMIT:
        return kept
    return _joined(found, fitted, kept, elsewhere)


def _of_the_fit(found: Identification) -> StatedNumbers:
    """All places of the numbers on which the data depend."""
    paths, deviations = _deviations(found)
    seen = found.seen
    covariance = deviations @ found.correlation[np.ix_(seen, seen)] @ deviations.T
    return with_covariance(paths, covariance)


def _deviations(found: Identification) -> tuple[tuple[str, ...], Table]:
    """Places of the unknowns on which the data depend, and the effect of a standard error of each.

    Returns:
        The paths, and the changes of their numbers [SI], shape (paths, unknowns).
    """
    unknowns = [found.unknowns[k] for k in found.seen.tolist()]
    paths = tuple(dict.fromkeys(path for unknown in unknowns for path in unknown.paths))
    deviations = np.zeros((len(paths), len(unknowns)))
    for k, unknown in enumerate(unknowns):
        for path, factor in zip(unknown.paths, unknown.factors, strict=True):
            deviations[paths.index(path), k] = factor * found.stddev[found.seen[k]]
    return paths, deviations


def _joined(
    found: Identification, fitted: StatedNumbers, kept: StatedNumbers, elsewhere: Collection[str]
) -> StatedNumbers:
    """Both, with others that the fit left alone if its numbers depend on them."""
    size, stated = len(fitted.paths), len(kept.paths)
    others = found.others
    if others is None:
        chosen, index = [], {}
    else:
        named = {*fitted.paths, *kept.paths, *elsewhere}
        chosen = _noticeable(found, named, COVARIANCE_LIMIT - size - stated)
        index = {path: k for k, path in enumerate(others.paths)}
    rest = (*kept.paths, *chosen)
    together = np.eye(size + len(rest))
    together[:size, :size] = fitted.correlation
    stddev = [*fitted.stddev, *kept.stddev]
    if others is not None:
        columns = np.array([index.get(path, -1) for path in rest], dtype=np.int64)
        _, deviations = _deviations(found)
        cross = np.pad(others.with_fitted, ((0, 0), (0, 1)))[np.ix_(found.seen, columns)]
        together[:size, size:] = deviations @ cross / np.array(fitted.stddev)[:, None]
        together[size:, :size] = together[:size, size:].T
        new = [index[path] for path in chosen]
        together[size + stated :, size + stated :] = others.correlation[np.ix_(new, new)]
        stddev += others.stddev[new].tolist()
    together[size : size + stated, size : size + stated] = kept.correlation
    return StatedNumbers((*fitted.paths, *rest), tuple(stddev), together)


def _noticeable(found: Identification, named: Collection[str], most: int) -> list[str]:
    """Numbers with a default standard deviation with which errors of the fitted ones go.

    Groups of numbers that deviate together are taken whole, those with the largest effect first.
    """
    others = found.others
    assert others is not None
    effect = np.abs(others.with_fitted[found.seen]).max(axis=0, initial=0.0)
    chosen: list[str] = []
    for group in sorted(others.groups, key=lambda one: -effect[list(one)].max()):
        paths = [others.paths[k] for k in group]
        if effect[list(group)].max() < NOTICEABLE:
            break
        if not set(named).intersection(paths) and len(chosen) + len(paths) <= most:
            chosen += paths
    return chosen


def stated_lines(numbers: StatedNumbers) -> list[str]:
    """The lines of the parameters, their standard deviations and correlation.

    Many numbers are written in groups that are not correlated.
    """
    if len(numbers.paths) <= COVARIANCE_LIMIT:
        return _lines(numbers, "  ")
    lines = ["  groups:"]
    for group in related(numbers.correlation):
        first, *rest = _lines(numbers.part(group), "      ")
        lines += [f"    - {first.lstrip()}", *rest]
    return lines


def _lines(numbers: StatedNumbers, indent: str) -> list[str]:
    if not numbers.paths:
        return []
    return [
        f"{indent}parameters:",
        *(f"{indent}  - {path}" for path in numbers.paths),
        f"{indent}stddev: [{', '.join(yaml_number(s, 3) for s in numbers.stddev)}]",
        f"{indent}correlation:  # its lower triangle",
        *(
            f"{indent}  - ["
            + ", ".join(f"{value:.5f}".rstrip("0").rstrip(".") for value in row[: k + 1])
            + "]"
            for k, row in enumerate(numbers.correlation)
        ),
    ]


def fit_errors(found: Identification) -> dict[str, float]:
    """Errors of the model by channel [N] or [N m], as far as the fitted recordings show them."""
    return {
        name: left.error
        for name, left in found.unexplained.items()
        if left.error > 0.0 and name.startswith(KINDS)
    }
