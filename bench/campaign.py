"""Duration of ``validate`` for many bags, on one core and on all, and of a fit to a long bag."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.figures import BAG, ROBOT, Row, Spread, compared, seconds, turns
from bench.offline import DURATION_S, write_long_bag
from cdrj_ros.bag import read_recording
from cdrj_ros.campaign.tasks import processors

BAGS = 6
ROUNDS = 3
MANY_S = 60.0
"""Time for the rounds of ``validate``."""
FIT_S = 40.0
"""Time for the rounds of ``identify``."""
EIGHT = "rho,preload,EA,f_d"
"""Numbers to fit: four keys with a number for each of the prototype's two cables."""


def _run(command: str, *arguments: object, processors: int | None = None) -> None:
    """Run a command, on some of the processors or on all."""
    own = sorted(os.sched_getaffinity(0))[:processors]
    program = f"import os; os.sched_setaffinity(0, {own}); "
    program += f"from cdrj_ros.commands.entry import {command}; {command}()"
    given = [*map(str, arguments), "--robot", str(ROBOT)]
    subprocess.run(
        [sys.executable, "-c", program, *given],
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def measure() -> list[Row]:
    """Seconds for ``BAGS`` bags of ``DURATION_S`` each, and for a fit to one of them."""
    with TemporaryDirectory() as folder:
        bag = Path(folder, "long")
        write_long_bag(bag, read_recording(BAG))
        bags = [bag] * BAGS
        together, alone, in_turn = [], [], []
        _run("validate", bag, "--uncertainty", "on")  # compiles and fills the file cache
        common = (*bags, "--quiet", "--uncertainty", "on")
        for _ in turns(ROUNDS, MANY_S):
            together.append(seconds(lambda: _run("validate", *common)))
            alone.append(seconds(lambda: _run("validate", *common, "--jobs", 1, processors=1)))
            in_turn.append(seconds(lambda: _run("validate", *common, "--jobs", 1)))
        fits = [
            seconds(lambda: _run("identify", bag, "--fit", EIGHT)) for _ in turns(ROUNDS, FIT_S)
        ]
    hours = BAGS * DURATION_S / 3600.0
    return [
        compared(
            "campaign", f"validate, {BAGS} bags of {DURATION_S} s, {processors()} processors", "s",
            together, "the same on one processor", alone, "< 0.59",
        ),
        compared(
            "campaign", "the same bags with --jobs 1, which estimates ahead in a thread", "s",
            in_turn, "on one processor", alone,
        ),
        Row(
            "campaign", "validate per hour of recordings, one processor", "s",
            Spread.of([taken / hours for taken in alone]),
        ),
        Row("campaign", f"identify, eight numbers, {DURATION_S} s bag", "s", Spread.of(fits),
            aim="< 12 s"),
    ]  # fmt: skip
