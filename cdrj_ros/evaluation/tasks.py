"""One task per recording, run here, in processes of this machine, or on a Dask cluster.

A task has the same input wherever it runs, and the results keep the order of the tasks; they are
therefore identical to the last digit.  The result of a task that fails is a ``Failed``.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Generic, TypeVar

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.files import size_of

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[float], None]

WORTH_PROCESSES: Final = 16 * 1024 * 1024
"""Total size of recordings above which additional processes save time despite their start [B]."""

SUFFIXES: Final = (".mcap", ".mcap.zstd", ".db3")
"""Ends of the names of recordings that are single files."""


@dataclass(frozen=True)
class Failed:
    """Result of a task that failed."""

    name: str
    """Of the task."""
    reason: str
    """One line."""


@dataclass(frozen=True)
class Work(Generic[T, R]):
    """Tasks of one kind."""

    function: Callable[[T, Progress], R]
    """Processes one task and reports the completed fraction; importable by name, so that other
    processes find it."""
    tasks: Sequence[T]
    names: Sequence[str]
    """Of the tasks, as the user knows them."""
    sizes: Sequence[int]
    """Of the tasks, in any unit; the progress is counted in it."""


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0))


def default_jobs(sizes: Sequence[int]) -> int:
    """Number of processes that pay off for recordings of these sizes [B]."""
    if sum(sizes) < WORTH_PROCESSES:
        return 1
    return max(1, min(processors(), len(sizes)))


def several_large(arguments: Sequence[str]) -> bool:
    """Whether a command that has not parsed its arguments yet is going to need processes."""
    if any(one.startswith(("--job", "--sched")) for one in arguments):
        return False
    paths = [one for one in arguments if one.endswith(SUFFIXES) or Path(one).is_dir()]
    return default_jobs([size_of(path) for path in paths]) > 1


def reason_of(error: Exception) -> str:
    """Why a task failed, in one line."""
    if isinstance(error, CdrjError):
        return str(error)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}"
    return f"unexpected {type(error).__name__}: {' '.join(str(error).split())}"


def attempt(function: Callable[[T, Progress], R], task: T, name: str, on: Progress) -> R | Failed:
    """Process one task; an exception becomes its ``Failed``."""
    try:
        return function(task, on)
    except Exception as error:  # noqa: BLE001  one failure must not stop the other tasks
        return Failed(name, reason_of(error))


def in_this_process(work: Work[T, R], report: Progress) -> list[R | Failed]:
    """Process the tasks one after another.

    Args:
        work: the tasks.
        report: called with the amount done, in the unit of the sizes.
    """
    results: list[R | Failed] = []
    done = 0.0
    for task, name, size in zip(work.tasks, work.names, work.sizes, strict=True):

        def within(share: float, before: float = done, size: int = size) -> None:
            report(before + share * size)

        results.append(attempt(work.function, task, name, within))
        done += size
        report(done)
    return results
