"""Time from the start of a process until its node works, and its memory at that time.

A node counts as started when its log says so, after all its topics and services exist.  Discovery
by other nodes depends on the middleware, is the same for every node and is not included.
"""

from __future__ import annotations

import subprocess
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from bench.figures import Row, alone, turns
from bench.processes import end, estimator_command, node_command

ROUNDS = 5
WITHIN_S = 25.0
"""Time for the rounds."""


class Started(NamedTuple):
    """Duration and memory of one start of a node."""

    ready_s: float
    """Time until its log reports that it works [s]."""
    memory_mb: float
    """Resident memory at that time [MB]."""


def started(command: list[str], said: bytes) -> Started:
    """Start a node, wait until it works and end it.

    Args:
        command: of the node.
        said: what it logs when it works.

    Raises:
        RuntimeError: the process ended earlier.
    """
    begin = perf_counter()
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
    try:
        assert process.stderr is not None
        for line in process.stderr:
            now = perf_counter() - begin
            if said in line:
                return Started(now, _resident_mb(process.pid))
        raise RuntimeError(f"{command[0]} ended early, exit code {process.wait()}")
    finally:
        with suppress(OSError):
            end(process)


def _resident_mb(process: int) -> float:
    for line in Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) * 1024e-6
    raise RuntimeError("this system does not tell how much memory a process takes")


def measure() -> list[Row]:
    """Start times [s] and memory [MB] of estimator and bare node, after a first start of each."""
    ours, theirs = [], []
    estimator, bare = estimator_command("info"), node_command("bare")
    for k in turns(ROUNDS + 1, WITHIN_S):
        mine, other = started(estimator, b"pulleys"), started(bare, b"listening")
        if k > 0:
            ours.append(mine)
            theirs.append(other)
    pairs = list(zip(ours, theirs, strict=True))
    later = [mine.ready_s - other.ready_s for mine, other in pairs]
    larger = [mine.memory_mb - other.memory_mb for mine, other in pairs]
    return [
        alone("start of the estimator: more than a bare node", "s", later, "≤ 0.2"),
        alone("memory of the estimator: more than a bare node", "MB", larger, "≤ 45"),
    ]
