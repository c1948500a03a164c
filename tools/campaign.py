#!/usr/bin/env python3
"""Run estimators beside simulated rigs with faults, and write the table of docs/reliability.md.

python tools/campaign.py                 6 runs of every kind of fault, 60 of mixed ones
python tools/campaign.py --only predict  only the kinds whose name contains the word; no table
python tools/campaign.py --runs 20 --mixed 300 --write    write the table into the page
"""

from __future__ import annotations

import argparse
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "test")]

from support import campaign, driver_draws, driver_faults  # noqa: E402
from support import campaign_draws as draws  # noqa: E402

from cdrj_ros.evaluation.validation import prepared_model  # noqa: E402

ROBOT = str(ROOT / "config" / "robots" / "prototype.yaml")
PAGE = ROOT / "docs" / "reliability.md"
TABLE = re.compile(r"(<!-- campaign -->\n).*?(<!-- /campaign -->)", re.DOTALL)
LAW = 0.001
"""Greatest share of tensions with status 0 beyond five standard deviations."""
MIXED = "one to three of these"
HEAD = (
    "| fault | status 0 | beyond 2σ | beyond 5σ | worst |",
    "|---|---|---|---|---|",
)


class Result(NamedTuple):
    """What came out of one run."""

    kind: str
    judged: int
    good: int
    beyond_two: int
    beyond_five: int
    worst: float
    words: str

    @property
    def share(self):
        """Share of the tensions with status 0 beyond five standard deviations [-]."""
        return self.beyond_five / max(self.good, 1)


@cache
def _course(index):
    return draws.course(prepared_model(ROBOT), index)


def run(kind, seed):
    """One run of a kind of fault, or of several together."""
    if kind in driver_draws.DRIVERS:
        return _run_driver(kind, seed)
    if kind == MIXED:
        kinds, faults = draws.mixed(seed)
        words = " + ".join(kinds)
    else:
        faults, words = draws.single(kind, seed), ""
    first = 0 if kind == MIXED else 3 * list(draws.SINGLE).index(kind)
    index = (first + 7 * seed) % draws.COURSES
    course = _course(index)
    with TemporaryDirectory() as folder:
        outputs = campaign.run(prepared_model(ROBOT), course, faults, scratch=Path(folder))
    said = f"course {index}, seed {seed}: {words} {faults.words()}"
    return _result(kind, course, outputs, said)


def _run_driver(kind, seed):
    """One run of a driver."""
    index = (3 * list(driver_draws.DRIVERS).index(kind) + 7 * seed) % draws.COURSES
    course = _course(index)
    messages = driver_draws.messages(prepared_model(ROBOT), course, kind, seed)
    outputs = driver_faults.feed(prepared_model(ROBOT), messages)
    return _result(kind, course, outputs, f"course {index}, seed {seed}")


def _result(kind, course, outputs, words):
    """The verdict on a run."""
    verdict = campaign.judge(course, outputs)
    two, five = (round(verdict.beyond(s) * verdict.ratio.size) for s in (2.0, 5.0))
    return Result(kind, verdict.judged, verdict.ratio.size, two, five, verdict.worst, words)


def row(kind, results):
    """The row of a kind of fault."""
    judged, good, two, five = (
        sum(getattr(one, key) for one in results)
        for key in ("judged", "good", "beyond_two", "beyond_five")
    )
    share = f"{good / max(judged, 1):.1%}".replace("%", " %")
    beyond = " | ".join(f"{100 * n / max(good, 1):.2g} %" for n in (two, five))
    worst = max(one.worst for one in results)
    return f"| {kind} | {share} | {beyond} | {worst:.1f} N |"


def summary(results):
    """How many runs there were, and which kinds of faults have runs beyond the law."""
    over = [one.kind for one in results if one.share > LAW]
    named = ", ".join(f"{kind} ({over.count(kind)})" for kind in dict.fromkeys(over)) or "none"
    mixed = sum(one.kind == MIXED for one in results)
    return f"{len(results)} runs, {mixed} with one to three faults. Beyond the law: {named}."


def main():
    """Run, print, and write if asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=6, help="runs of every kind (6)")
    parser.add_argument("--mixed", type=int, default=60, help="runs of mixed faults (60)")
    parser.add_argument("--only", default="", help="only kinds whose name contains this")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--write", action="store_true", help="write the table into the page")
    arguments = parser.parse_args()
    kinds = (*draws.SINGLE, *driver_draws.DRIVERS)
    tasks = [(kind, seed) for kind in kinds for seed in range(arguments.runs)]
    tasks += [(MIXED, seed) for seed in range(arguments.mixed)]
    tasks = [task for task in tasks if arguments.only in task[0]]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        results = list(pool.map(run, *zip(*tasks, strict=True)))
    own = {kind: [one for one in results if one.kind == kind] for kind in (*kinds, MIXED)}
    rows = [row(kind, some) for kind, some in own.items() if some]
    table = "\n".join([*HEAD, *rows, "", summary(results)])
    print(table)
    for one in sorted(results, key=lambda one: -one.share):
        if one.share > LAW:
            print(f"{one.share:.2%}, {one.worst:.1f} N: {one.kind}, {one.words}")
    if arguments.write and not arguments.only:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(TABLE.sub(lambda m: f"{m[1]}{table}\n{m[2]}", page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
