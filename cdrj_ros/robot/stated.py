"""What a robot file states of the accuracy of its numbers: the block ``uncertainty``.

Numbers whose errors are not correlated may stand in separate entries of ``groups``: a hand has some
hundred numbers for each finger.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Table
from cdrj_ros.foundation.errors import Refusal
from cdrj_ros.foundation.yaml import Document


class StatedNumbers(NamedTuple):
    """Some numbers of a robot file, and what is known of them."""

    paths: tuple[str, ...]
    stddev: tuple[float, ...]
    """Standard deviations [SI]."""
    correlation: Table
    """Shape (n, n)."""

    @property
    def covariance(self) -> Table:
        """[SI], shape (n, n)."""
        return self.correlation * np.outer(self.stddev, self.stddev)

    def part(self, at: Sequence[int]) -> StatedNumbers:
        """Some of the numbers, by index."""
        return StatedNumbers(
            tuple(self.paths[k] for k in at),
            tuple(self.stddev[k] for k in at),
            self.correlation[np.ix_(at, at)],
        )


def with_covariance(paths: Sequence[str], covariance: Table) -> StatedNumbers:
    """Numbers with a covariance [SI], shape (n, n)."""
    stddev = np.sqrt(np.diag(covariance))
    safe = np.where(stddev > 0.0, stddev, 1.0)
    correlation = covariance / np.outer(safe, safe)
    np.fill_diagonal(correlation, 1.0)
    return StatedNumbers(tuple(paths), tuple(stddev.tolist()), correlation)


def joined(parts: Sequence[StatedNumbers]) -> StatedNumbers:
    """Numbers of several parts, whose errors are independent."""
    size = sum(len(part.paths) for part in parts)
    correlation, at = np.eye(size), 0
    for part in parts:
        inside = slice(at, at := at + len(part.paths))
        correlation[inside, inside] = part.correlation
    return StatedNumbers(
        tuple(path for part in parts for path in part.paths),
        tuple(stddev for part in parts for stddev in part.stddev),
        correlation,
    )


def related(correlation: Table, negligible: float = 0.0) -> list[list[int]]:
    """Indices of numbers in groups without any more correlation between them."""
    linked = (correlation > negligible) | (correlation < -negligible)
    left, groups = np.ones(len(linked), dtype=np.bool_), list[list[int]]()
    for start in range(len(linked)):
        if left[start]:
            left[start] = False
            groups.append(group := [start])
            for k in group:  # which grows
                more = np.flatnonzero(linked[k] & left)
                left[more] = False
                group += more.tolist()
    return [sorted(group) for group in groups]


def stated_numbers(entry: Mapping[str, Any]) -> StatedNumbers:
    """All numbers of a block ``uncertainty``, its groups included.

    Args:
        entry: the block, valid.
    """
    parts = []
    for one in (entry, *entry.get("groups", ())):
        paths = tuple(one.get("parameters", ()))
        correlation = _correlation(one.get("correlation"), len(paths))
        parts.append(StatedNumbers(paths, tuple(map(float, one.get("stddev", ()))), correlation))
    return joined(parts)


def _correlation(rows: Sequence[Sequence[float]] | None, size: int) -> Table:
    """The correlation matrix of numbers from its rows, or from those of its lower triangle."""
    matrix = np.eye(size)
    for k, row in enumerate(rows or ()):
        matrix[k, : len(row)] = row
    if rows and len(rows[0]) < size:
        matrix += np.tril(matrix, -1).T
    return matrix


def check_stated(entry: Document, refuse: Refusal) -> None:
    """Refuse a block ``uncertainty`` whose numbers do not belong together.

    Raises:
        RobotFileError: names the key, what was given and what is allowed.
    """
    named: list[str] = []
    places = [f"uncertainty.groups[{k}]" for k in range(len(entry.get("groups", ())))]
    for place, one in zip(("uncertainty", *places), (entry, *entry.get("groups", ())), strict=True):
        _check_group(place, one, refuse)
        named += one.get("parameters", ())
    if len(set(named)) != len(named):
        raise refuse("uncertainty.parameters", "must name every parameter once")


def _check_group(place: str, entry: Document, refuse: Refusal) -> None:
    names, stddev = entry.get("parameters", []), entry.get("stddev", [])
    if len(stddev) != len(names):
        raise refuse(
            f"{place}.stddev",
            f"must have one entry for each of {len(names)} parameters, got {len(stddev)}",
        )
    size, rows = len(names), entry.get("correlation")
    lengths = [len(row) for row in rows] if rows is not None else [size] * size
    if lengths not in ([size] * size, [*range(1, size + 1)]):
        raise refuse(
            f"{place}.correlation",
            f"must have {size} rows of {size} numbers, or its lower triangle, of 1 to {size}",
        )
    correlation = _correlation(rows, size)
    if len(names) and (
        not np.allclose(correlation, correlation.T, atol=1e-6)
        or not np.allclose(np.diag(correlation), 1.0, atol=1e-6)
        or np.linalg.eigvalsh(correlation)[0] < -1e-3
    ):
        raise refuse(
            f"{place}.correlation",
            "must be symmetric, with 1 on the diagonal and no negative eigenvalue",
        )
