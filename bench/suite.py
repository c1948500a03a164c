"""Time of ``make test``."""

from __future__ import annotations

import re

from bench.figures import ROOT, Row, Spread, additions
from bench.making import make

SUMMARY = re.compile(r"\d+ passed\b.* in ([0-9.]+)s\b")
"""The last line of pytest; the tests of the sanitized core follow those of the project."""


def measure() -> list[Row]:
    """`make test` in this folder, and what pytest says of its own time [s].

    Raises:
        RuntimeError: a check or a test failed, or pytest did not say its time.
    """
    speed = [additions()]
    said = make(ROOT, "test")
    speed.append(additions())
    alone = [float(found[1]) for _, line in said if (found := SUMMARY.search(line))]
    if not alone:
        raise RuntimeError("make test did not say how long pytest took")
    return [
        Row("tests", "make test, whole", "s", Spread.of([said[-1].after_s]), aim="≤ 210"),
        Row("tests", "make test, pytest alone", "s", Spread.of([alone[0]])),
        Row("tests", "ten million additions in Python, before and after", "s", Spread.of(speed)),
    ]
