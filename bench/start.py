"""Time from the start of a process until its node works.

A node counts as started when its log says so, after all its topics and services exist.  Discovery
by other nodes depends on the middleware, is the same for every node and is not included.
"""

from __future__ import annotations

import subprocess
from contextlib import suppress
from time import perf_counter

from bench.figures import Row, Spread, compared
from bench.processes import end, estimator_command, node_command

ROUNDS = 5


def started(command: list[str], said: bytes) -> float:
    """Time from the start of the process until its log reports that it works [s].

    Raises:
        RuntimeError: the process ended earlier.
    """
    begin = perf_counter()
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
    try:
        assert process.stderr is not None
        for line in process.stderr:
            if said in line:
                return perf_counter() - begin
        raise RuntimeError(f"{command[0]} ended early, exit code {process.wait()}")
    finally:
        with suppress(OSError):
            end(process)


def measure() -> list[Row]:
    """Start times [s] with kernels compiled earlier."""
    ours, theirs = [], []
    estimator, bare = estimator_command("info"), node_command("bare")
    for k in range(ROUNDS + 1):
        mine, other = started(estimator, b"pulleys"), started(bare, b"listening")
        if k > 0:
            ours.append(mine)
            theirs.append(other)
    difference = [mine - other for mine, other in zip(ours, theirs, strict=True)]
    return [
        compared(
            "start", "estimator, kernels compiled before", "s", ours,
            "bare node: one publisher, one subscription", theirs,
        ),
        Row("start", "difference", "s", Spread.of(difference), aim="≤ 1"),
    ]  # fmt: skip
