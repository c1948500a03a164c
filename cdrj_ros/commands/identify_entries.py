"""The entries of the robot file that ``identify`` writes: ``uncertainty`` and ``residual``."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np

from cdrj_ros.commands.identify_task import Task
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.output import say
from cdrj_ros.identification.alternatives import DrumFinding
from cdrj_ros.identification.fit import Identification
from cdrj_ros.identification.observations import Recorded, chosen_channels
from cdrj_ros.identification.residual import FEWEST_BAGS, Learned, learn
from cdrj_ros.identification.residual_statistics import model_error
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.table import Columns
from cdrj_ros.robot.description import Residual
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.stated import (
    StatedNumbers,
    independent_groups,
    stated_numbers,
    with_covariance,
)
from cdrj_ros.robot.writer import with_section, yaml_number

KINDS: Final = ("effort/", "tension/")
"""Channels for which a robot file can state the model's error."""

COVARIANCE_LIMIT: Final = 128
"""Parameters whose covariance a robot file can hold."""

NOTICEABLE: Final = 0.02
"""Correlation with a fitted number from which a number that was not fitted is written."""


def uncertainty_section(
    found: Identification,
    before: Mapping[str, Any],
    errors: Mapping[str, float],
    *,
    unseen: bool = False,
) -> str:
    """The entry ``uncertainty`` of the robot file.

    Args:
        found: the fit.
        before: the same entry before the fit; what it states about other numbers is kept.
        errors: errors of the model by channel; if empty, those of ``before`` are kept.
        unseen: whether they are from recordings that were not fitted.
    """
    numbers = fitted_numbers(found, before)
    return section_with(numbers, before, errors, found.drums, unseen=unseen)


def section_with(
    numbers: StatedNumbers,
    before: Mapping[str, Any],
    errors: Mapping[str, float],
    drums: Mapping[str, DrumFinding],
    *,
    unseen: bool = False,
) -> str:
    """The entry ``uncertainty`` with some numbers; other arguments as ``uncertainty_section``."""
    lines = ["uncertainty:                    # standard deviations and correlations of the fit"]
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
    for group in independent_groups(numbers):
        first, *rest = _lines(group, "      ")
        lines += [f"    - {first.lstrip()}", *rest]
    return lines


def _lines(numbers: StatedNumbers, indent: str) -> list[str]:
    if not numbers.paths:
        return []
    return [
        f"{indent}parameters:",
        *(f"{indent}  - {path}" for path in numbers.paths),
        f"{indent}stddev: [{', '.join(yaml_number(s, 3) for s in numbers.stddev)}]",
        f"{indent}correlation:",
        *(
            f"{indent}  - ["
            + ", ".join(f"{value:.5f}".rstrip("0").rstrip(".") for value in row)
            + "]"
            for row in numbers.correlation
        ),
    ]


def fit_errors(found: Identification) -> dict[str, float]:
    """Errors of the model by channel [N] or [N m], as far as the fitted recordings show them."""
    return {
        name: left.error
        for name, left in found.unexplained.items()
        if left.error > 0.0 and name.startswith(KINDS)
    }


def model_errors(
    model: Model, unseen: Sequence[BagComparison], topics: Topics | Columns, channels: Sequence[str]
) -> dict[str, float]:
    """Errors of the model by channel [N] or [N m], without channels that the numbers explain.

    Args:
        model: the fitted robot, with the standard deviations of its numbers alone.
        unseen: comparisons of bags with estimates that were not fitted to them.
        topics: topics of the bags.
        channels: the references that were fitted.
    """
    residuals: dict[str, list[Vector]] = {}
    stddevs: dict[str, list[Vector]] = {}
    for one in unseen:
        again = validate_bag(model, one.path, topics, uncertainty=True)
        stddev = {channel.name: channel.stddev for channel in again.channels}
        for channel in one.channels:
            own = stddev.get(channel.name)
            if own is not None and own.size == channel.estimate.size:
                residual = channel.estimate - channel.reference
                residuals.setdefault(channel.name, []).append(residual)
                stddevs.setdefault(channel.name, []).append(own)
    errors = {
        name: model_error(residuals[name], stddevs[name])
        for name in channels
        if name in residuals and name.startswith(KINDS)
    }
    return {name: error for name, error in errors.items() if error > 0.0}


def with_residuals(text: str, task: Task, recordings: Sequence[Recorded]) -> str:
    """The robot file's text with learned corrections, of which a line each is printed.

    Args:
        text: of the robot file, without corrections.
        task: the request.
        recordings: of its bags.
    """
    model = prepare(parse_robot(text, task.source))
    channels = chosen_channels(model.layout, recordings, task.settings.channels)
    outputs = [name for name in channels if name.startswith(KINDS)]
    found = list(learn(model, recordings, outputs, task.settings.settle_s))
    say("\nlearned corrections; errors on bags left out of them")
    for one in found:
        say(_line(one))
    for name in outputs:
        if name not in {one.output for one in found}:
            say(f"{name}: none, because fewer than {FEWEST_BAGS} bags have it")
    residuals = [one.residual for one in found if one.residual is not None]
    return with_section(text, "residual", residual_section(residuals) if residuals else None)


def _line(learned: Learned) -> str:
    if learned.residual is None:
        return (
            f"{learned.output}: none, because its RMSE of {learned.before:.4g} would only become "
            f"{learned.after:.4g}"
        )
    return (
        f"{learned.output}: RMSE {learned.before:.4g} without, {learned.after:.4g} with; at most "
        f"{learned.residual.bound:.4g}"
    )


def residual_section(residuals: Sequence[Residual]) -> str:
    """The entry ``residual`` of the robot file."""
    lines = ["residual:                       # learned corrections on top of the model"]
    for one in residuals:
        lines += [
            f"  - output: {one.output}",
            f"    bound: {yaml_number(one.bound, 3)}",
            f"    stddev: {yaml_number(one.stddev, 3)}  # of the error that is left",
            "    inputs:  # with the range that was seen",
            *(f"      {name}: {_numbers(seen)}" for name, seen in one.inputs.items()),
            "    weights:  # columns: 1, inputs; rows: value, three stops, last motion of each",
            *(f"      - {_numbers(row)}" for row in one.weights.tolist()),
        ]
    return "\n".join(lines)


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(yaml_number(value, 4) for value in values) + "]"
