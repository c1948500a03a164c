"""One task per recording, in this process, in several of this machine, or on a cluster.

joblib runs the tasks, by default in processes of this machine.  Within ``joblib.parallel_config``
it runs them wherever that says, a Dask or Ray cluster for example.  A task has the same input
wherever it runs, and the results keep the order of the tasks; they are therefore identical to the
last digit.  A task that fails, or whose process dies, does not stop the others: its result is a
``Failed``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

import joblib
from joblib.parallel import get_active_backend

from cdrj_ros.foundation.errors import CdrjError, reason_of

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[float], None]

WORTH_PROCESSES: Final = 16 * 1024 * 1024
"""Total size of recordings above which additional processes save time despite their start [B]."""


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

    function: Callable[[T], R]
    """Processes one task; importable by name, so that other processes find it."""
    tasks: Sequence[T]
    names: Sequence[str]
    """Of the tasks, as the user knows them."""
    sizes: Sequence[int]
    """Of the tasks, in any unit; the progress is counted in it."""


def processors() -> int:
    """Number of tasks that can run at a time: on this machine's processors, or on the cluster."""
    return int(joblib.effective_n_jobs(-1))


def default_jobs(sizes: Sequence[int]) -> int:
    """Number of processes that pay off for recordings of these sizes [B]."""
    if sum(sizes) < WORTH_PROCESSES:
        return 1
    return max(1, min(processors(), len(sizes)))


def results_of(work: Work[T, R], jobs: int, report: Progress) -> list[R | Failed]:
    """The results of all tasks.

    Large tasks begin first: at the end they would leave other processes idle.  The death of a
    process may also cost tasks that were waiting; they are then tried one by one.

    Args:
        work: the tasks.
        jobs: number of tasks at a time; with 1, they run in this process.  A cluster runs as many
            as it has processors.
        report: called with the amount done, in the unit of the sizes.
    """
    order = sorted(range(len(work.tasks)), key=lambda k: -work.sizes[k])
    found: dict[int, R | Failed] = {}

    def note(k: int, result: R | Failed) -> None:
        found[k] = result
        report(sum(work.sizes[k] for k in found))

    try:
        results = _results(work, order, jobs)
        for result, k in zip(results, order, strict=True):
            note(k, result)
    except BrokenProcessPool:
        for k in sorted(set(order) - set(found)):
            try:
                (result,) = _results(work, [k], 2)  # not in this process
                note(k, result)
            except BrokenProcessPool:
                reason = f"{work.names[k]}: its process died, twice (out of memory?)"
                note(k, Failed(work.names[k], reason))
    return [found[k] for k in range(len(work.tasks))]


def _results(work: Work[T, R], which: Sequence[int], jobs: int) -> Iterator[R | Failed]:
    """The results of some tasks, as they come if joblib's backend can do this."""
    as_they_come = get_active_backend()[0].supports_return_generator
    parallel = joblib.Parallel(
        n_jobs=jobs, batch_size=1, return_as="generator" if as_they_come else "list"
    )
    attempt = joblib.delayed(_attempt)
    return iter(parallel(attempt(work.function, work.tasks[k], work.names[k]) for k in which))


def _attempt(function: Callable[[T], R], task: T, name: str) -> R | Failed:
    """Process one task; an exception becomes its ``Failed``."""
    try:
        return function(task)
    except (CdrjError, OSError) as error:
        return Failed(name, reason_of(error))
    except Exception as error:  # noqa: BLE001  one failure must not stop the other tasks
        words = " ".join(str(error).split())
        return Failed(name, f"unexpected {type(error).__name__}: {words}")
