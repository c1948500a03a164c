"""Rows of the benchmark's table: medians, and ratios of neighbouring rounds."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
ROBOT = ROOT / "config" / "robots" / "prototype.yaml"
BAG = ROOT / "bags" / "prototype_preload_36_26"


@dataclass(frozen=True)
class Row:
    """One line of the table, of medians."""

    what: str
    unit: str
    ours: float
    aim: str = ""
    """Aim, such as ``≤ 1.15``, for the ratio or, without a peer, for our value."""
    beside: str = ""
    """The peer; empty for a figure without one."""
    theirs: float | None = None
    ratio: float | None = None
    """Ours over theirs, taken between neighbouring rounds."""

    @property
    def missed(self):
        """Whether the median misses the aim; False if the aim is not a number."""
        found = re.match(r"[<≤] ([0-9.]+)", self.aim)
        value = self.ours if self.ratio is None else self.ratio
        return found is not None and value > float(found[1])

    def line(self):
        """The row in Markdown."""
        numbers = (self.ours, self.theirs, self.ratio)
        units = (self.unit, self.unit, "")
        ours, theirs, ratio = (
            "" if number is None else f"{f'{number:#.3g}'.rstrip('.')} {unit}".strip()
            for number, unit in zip(numbers, units, strict=True)
        )
        aim = self.aim + (" **missed**" if self.missed else "")
        return f"| {self.what} | {ours} | {self.beside} | {theirs} | {ratio} | {aim} |"


def alone(what, unit, ours, aim):
    """Build a row without a peer."""
    return Row(what, unit, float(np.median(ours)), aim)


def compared(what, unit, ours, beside, theirs, aim=""):
    """Build a row from alternating rounds; the ratio is taken round by round."""
    ratio = np.asarray(ours, dtype=float) / np.asarray(theirs, dtype=float)
    medians = (float(np.median(one)) for one in (theirs, ratio))
    return Row(what, unit, float(np.median(ours)), aim, beside, *medians)


def seconds(function, clock=perf_counter):
    """Duration of one call by a clock [s]."""
    begin = clock()
    function()
    return clock() - begin


def processor_seconds(function):
    """Processor time of one call [s]."""
    return seconds(function, process_time)


def in_turn(rounds, *functions):
    """Time several functions in alternation, A B A B, after one warm-up round.

    A temporary disturbance of the machine then affects neighbouring rounds alike and cancels in
    their ratio.

    Returns:
        Processor times [s], one list of ``rounds`` values per function.
    """
    for function in functions:
        function()
    times = [[] for _ in functions]
    for _ in range(rounds):
        for taken, function in zip(times, functions, strict=True):
            taken.append(processor_seconds(function))
    return times


def there_and_back(angles):
    """Readings of a motion and of the way back, shape (n, axes), which may be repeated."""
    return np.concatenate([angles, angles[-2:0:-1]])
