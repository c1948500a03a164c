"""Duration of ``validate`` for many bags, on one core and on all, and of a fit to a long bag."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.figures import BAG, ROBOT, Row, alone, compared, seconds, turns
from bench.offline import DURATION_S, write_long_bag
from cdrj_ros.evaluation.parallel import processors
from cdrj_ros.recordings.recording import read_recording

BAGS = 6
ROUNDS = 3
MANY_S = 90.0
"""Time for the rounds of ``validate``."""
FIT_S = 40.0
"""Time for the rounds of ``identify``."""
EIGHT = "rho,preload,EA,f_d"
"""Numbers to fit: four keys with a number for each of the prototype's two cables."""


def _run(command: str, *arguments: object, on: int | None = None) -> None:
    """Run a command on one of this process's processors, by index, or on all."""
    own = sorted(os.sched_getaffinity(0))
    kept = own if on is None else [own[on]]
    program = f"import os; os.sched_setaffinity(0, {kept}); "
    program += f"from cdrj_ros.commands.entry import {command}; {command}()"
    given = [*map(str, arguments), "--robot", str(ROBOT)]
    subprocess.run(
        [sys.executable, "-c", program, *given],
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def _at_once(start: Callable[[int], None]) -> None:
    """Start something for every processor, by index, and wait for all."""
    with ThreadPoolExecutor(processors()) as pool:
        list(pool.map(start, range(processors())))


def measure() -> list[Row]:
    """Seconds for ``BAGS`` bags of ``DURATION_S`` each, and for a fit to one of them."""
    with TemporaryDirectory() as folder:
        bag = Path(folder, "long")
        write_long_bag(bag, read_recording(BAG))
        bags = [bag] * BAGS
        together, alone_s, in_turn, separate = [], [], [], []
        _run("validate", bag)  # fills the file cache
        for _ in turns(ROUNDS, MANY_S):
            together.append(seconds(lambda: _run("validate", *bags)))
            alone_s.append(seconds(lambda: _run("validate", *bags, "--jobs", 1, on=0)))
            separate.append(
                seconds(
                    lambda: _at_once(
                        lambda k: _run("validate", *bags[k :: processors()], "--jobs", 1, on=k)
                    )
                )
            )
            in_turn.append(seconds(lambda: _run("validate", *bags, "--jobs", 1)))
        fits = [
            seconds(lambda: _run("identify", bag, "--fit", EIGHT)) for _ in turns(ROUNDS, FIT_S)
        ]
    bags = f"{BAGS} bags of {DURATION_S} s"
    what = f"validate, {bags}, {processors()} processors"
    apart = "the same bags, a command of its own on each processor"
    ahead = "the same bags with --jobs 1, which estimates ahead in a thread"
    return [
        compared(what, "s", together, "the same on one processor", alone_s, "< 0.59"),
        compared(apart, "s", separate, "on one processor", alone_s),
        compared(ahead, "s", in_turn, "on one processor", alone_s),
        alone(f"identify, eight numbers, {DURATION_S} s bag", "s", fits, "< 12 s"),
    ]
