"""Time from the start of a process until its node works, and its memory at that time.

A node counts as started when its log says so, after all its topics and services exist.  Discovery
by other nodes depends on the middleware, is the same for every node and is not included.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import NamedTuple

from bench.figures import Row, Spread, compared, turns
from bench.processes import end, estimator_command, node_command

ROUNDS = 5
SECOND_S = 25.0
"""Time for the rounds of second starts."""
FIRST_S = 30.0
"""Time for the rounds of first starts after a build."""
FROM_NOTHING = 3
"""Rounds of first starts that compile."""
NOTHING_S = 60.0
"""Time for them."""


class Started(NamedTuple):
    """Durations and memory of one start of a node."""

    line_s: float
    """Time until its first line of output [s]."""
    ready_s: float
    """Time until its log reports that it works [s]."""
    memory_mb: float
    """Resident memory at that time [MB]."""


def started(command: list[str], said: bytes, variables: Mapping[str, str] | None = None) -> Started:
    """Start a node, wait until it works and end it.

    Args:
        command: of the node.
        said: what it logs when it works.
        variables: of its environment.

    Raises:
        RuntimeError: the process ended earlier.
    """
    begin = perf_counter()
    environment = {**os.environ, **(variables or {})}
    process = subprocess.Popen(command, stderr=subprocess.PIPE, env=environment)
    line_s = 0.0
    try:
        assert process.stderr is not None
        for line in process.stderr:
            now = perf_counter() - begin
            line_s = line_s or now
            if said in line:
                return Started(line_s, now, _resident_mb(process.pid))
        raise RuntimeError(f"{command[0]} ended early, exit code {process.wait()}")
    finally:
        with suppress(OSError):
            end(process)


def _resident_mb(process: int) -> float:
    for line in Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) * 1024e-6
    raise RuntimeError("this system does not tell how much memory a process takes")


def _other_user(folder: Path) -> dict[str, str]:
    """Variables of a user who has never started the node; the installed kernels are available."""
    return {"HOME": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}


def _nobody(folder: Path) -> dict[str, str]:
    """Variables of a user with an empty kernel cache, so that every kernel has to be compiled."""
    return {**_other_user(folder), "NUMBA_CACHE_DIR": str(folder / "kernels")}


def _first_starts() -> list[Row]:
    """Compare first with second starts; each pair runs as a new user."""
    ready, rows = b"pulleys", []
    estimator = estimator_command("info")
    pairs: dict[str, list[tuple[Started, Started]]] = {"built": [], "nothing": []}
    for kind, variables, rounds, limit_s in (
        ("built", _other_user, ROUNDS, FIRST_S),
        ("nothing", _nobody, FROM_NOTHING, NOTHING_S),
    ):
        for _ in turns(rounds, limit_s):
            with TemporaryDirectory() as folder:
                given = variables(Path(folder))
                first = started(estimator, ready, given)
                pairs[kind].append((first, started(estimator, ready, given)))
    nothing = "first start without a compiled kernel"
    for kind, what, aim in (
        ("built", "first start after a build, another user: more than the second", "≤ 0.2"),
        ("nothing", f"{nothing}, until it estimates: more than the second", "≤ 5"),
    ):
        more = [first.ready_s - second.ready_s for first, second in pairs[kind]]
        rows.append(Row("start", what, "s", Spread.of(more), aim=aim))
    lines = [first.line_s for first, _ in pairs["nothing"]]
    what = f"{nothing}, until its first line"
    rows.append(Row("start", what, "s", Spread.of(lines), aim="≤ 1"))
    return rows


def measure() -> list[Row]:
    """Start times [s] and memory [MB] of estimator and bare node, then first starts."""
    ours, theirs = [], []
    estimator, bare = estimator_command("info"), node_command("bare")
    for k in turns(ROUNDS + 1, SECOND_S):
        mine, other = started(estimator, b"pulleys"), started(bare, b"listening")
        if k > 0:
            ours.append(mine)
            theirs.append(other)
    pairs = list(zip(ours, theirs, strict=True))
    later = [mine.ready_s - other.ready_s for mine, other in pairs]
    larger = [mine.memory_mb - other.memory_mb for mine, other in pairs]
    return [
        compared(
            "start", "second start of the estimator, until ready", "s",
            [one.ready_s for one in ours], "bare node: one publisher, one subscription",
            [one.ready_s for one in theirs],
        ),
        Row(
            "start", "second start of the estimator: more than the bare node", "s",
            Spread.of(later), aim="≤ 0.4",
        ),
        *_first_starts(),
        compared(
            "start", "memory of the estimator", "MB", [one.memory_mb for one in ours],
            "bare node", [one.memory_mb for one in theirs],
        ),
        Row(
            "start", "memory of the estimator: more than the bare node", "MB",
            Spread.of(larger), aim="≤ 120",
        ),
    ]  # fmt: skip
