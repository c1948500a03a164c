"""Rows of the benchmark's table: medians with quartiles, and ratios."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

ROOT = Path(__file__).resolve().parent.parent
ROBOT = ROOT / "config" / "robots" / "prototype.yaml"
BAG = ROOT / "bags" / "prototype_preload_36_26"


@dataclass(frozen=True)
class Spread:
    """A median and the quartiles around it."""

    median: float
    low: float
    high: float

    @staticmethod
    def of(values: ArrayLike) -> Spread:
        """Compute median and quartiles of a sample."""
        low, median, high = np.percentile(np.asarray(values, dtype=float), (25, 50, 75))
        return Spread(float(median), float(low), float(high))

    def text(self, digits: int = 3) -> str:
        """Format median and quartiles as ``4.51 (4.48–4.60)``."""
        shown = (f"{value:#.{digits}g}".rstrip(".") for value in (self.median, self.low, self.high))
        return "{} ({}–{})".format(*shown)


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    section: str
    what: str
    unit: str
    ours: Spread
    beside: str = ""
    """The peer; empty for a figure without one."""
    theirs: Spread | None = None
    ratio: Spread | None = None
    """Ours over theirs, taken between neighbouring rounds."""
    aim: str = ""
    """Aim, such as ``≤ 1.15``, for the ratio or, without a peer, for our value."""

    @property
    def missed(self) -> bool:
        """Whether the median misses the aim; False if the aim is not a number."""
        found = re.match(r"([<≤≥]) ([0-9.]+)", self.aim)
        if not found:
            return False
        value = (self.ratio or self.ours).median
        bound = float(found[2])
        return value < bound if found[1] == "≥" else value > bound

    def as_json(self) -> dict[str, Any]:
        """Convert the row to plain values for ``--json``."""
        return asdict(self)

    @staticmethod
    def from_json(found: Mapping[str, Any]) -> Row:
        """Restore a row from its plain values."""
        spreads = {
            name: Spread(**found[name]) if found[name] else None
            for name in ("ours", "theirs", "ratio")
        }
        return Row(**{**found, **spreads})


def compared(
    section: str,
    what: str,
    unit: str,
    ours: ArrayLike,
    beside: str,
    theirs: ArrayLike,
    aim: str = "",
) -> Row:
    """Build a row from alternating rounds; the ratio is taken round by round."""
    ratio = np.asarray(ours, dtype=float) / np.asarray(theirs, dtype=float)
    return Row(
        section, what, unit, Spread.of(ours), beside, Spread.of(theirs), Spread.of(ratio), aim
    )


def seconds(function: Callable[[], object]) -> float:
    """Duration of one call [s]."""
    begin = perf_counter()
    function()
    return perf_counter() - begin


def additions() -> float:
    """Duration of ten million additions in Python, which tells how fast the machine is now [s]."""

    def add() -> None:
        total = 0
        for k in range(10_000_000):
            total += k

    return seconds(add)


def in_turn(rounds: int, *functions: Callable[[], object]) -> list[list[float]]:
    """Time several functions in alternation, A B A B, after one warm-up round.

    A temporary disturbance of the machine then affects neighbouring rounds alike and cancels in
    their ratio.

    Returns:
        Durations [s], one list of ``rounds`` values per function.
    """
    for function in functions:
        function()
    times: list[list[float]] = [[] for _ in functions]
    for _ in range(rounds):
        for taken, function in zip(times, functions, strict=True):
            taken.append(seconds(function))
    return times


def turns(rounds: int, within_s: float) -> Iterator[int]:
    """Count rounds, at least one, and stop when another is unlikely to end ``within_s``."""
    begin = perf_counter()
    for k in range(rounds):
        if k > 0 and (perf_counter() - begin) * (k + 1) / k > within_s:
            return
        yield k
