"""One task per recording, in this process or in several processes of this machine.

A task has the same input wherever it runs, and the results keep the order of the tasks; they are
therefore identical to the last digit. A task that fails, or whose process dies, does not stop the
others: its result is a ``Failed``.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import active_children, forkserver, get_context
from multiprocessing.connection import wait
from multiprocessing.process import parent_process
from typing import Final, Generic, TypeVar

from cdrj_ros.foundation.errors import CdrjError, reason_of

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[float], None]

WORTH_PROCESSES: Final = 16 * 1024 * 1024
"""Total size of recordings above which additional processes save time despite their start [B]."""

POOL_S: Final = 10.0
"""Time allowed for closing a pool whose processes have been ended [s]."""


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
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0))


def default_jobs(sizes: Sequence[int]) -> int:
    """Number of processes that pay off for recordings of these sizes [B]."""
    if sum(sizes) < WORTH_PROCESSES:
        return 1
    return max(1, min(processors(), len(sizes)))


def in_this_process(work: Work[T, R], report: Progress) -> list[R | Failed]:
    """Process the tasks one after another.

    Args:
        work: the tasks.
        report: called with the amount done, in the unit of the sizes.
    """
    results: list[R | Failed] = []
    for task, name in zip(work.tasks, work.names, strict=True):
        results.append(_attempt(work.function, task, name))
        report(sum(work.sizes[: len(results)]))
    return results


def in_processes(work: Work[T, R], jobs: int, report: Progress) -> list[R | Failed]:
    """As ``in_this_process``, but ``jobs`` tasks at a time, each in a process of this machine.

    Large tasks begin first: at the end they would leave other processes idle.  The death of a
    process may also cost tasks that were waiting; they are then tried one by one.
    """
    forkserver.set_forkserver_preload([work.function.__module__])
    order = sorted(range(len(work.tasks)), key=lambda k: -work.sizes[k])
    found: dict[int, R | Failed] = {}

    def submitted(executor: Executor, k: int) -> Future[R | Failed]:
        return executor.submit(_attempt, work.function, work.tasks[k], work.names[k])

    def note(k: int, result: R | Failed) -> None:
        found[k] = result
        report(sum(work.sizes[k] for k in found))

    with _processes(jobs) as executor:
        futures = {submitted(executor, k): k for k in order}
        for future in as_completed(futures):
            if future.exception() is None:
                note(futures[future], future.result())
    for k in sorted(set(order) - set(found)):
        with _processes(1) as executor:
            future = submitted(executor, k)
            reason = f"{work.names[k]}: its process died, twice (out of memory?)"
            died = future.exception() is not None
            note(k, Failed(work.names[k], reason) if died else future.result())
    return [found[k] for k in range(len(work.tasks))]


def _attempt(function: Callable[[T], R], task: T, name: str) -> R | Failed:
    """Process one task; an exception becomes its ``Failed``."""
    try:
        return function(task)
    except (CdrjError, OSError) as error:
        return Failed(name, reason_of(error))
    except Exception as error:  # noqa: BLE001  one failure must not stop the other tasks
        words = " ".join(str(error).split())
        return Failed(name, f"unexpected {type(error).__name__}: {words}")


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    """Processes that are ended on an error or Ctrl-C, for which the pool alone would wait.

    Nor is the pool's own thread waited for long: Ctrl-C may have left a lock that it needs.
    """
    pool = ProcessPoolExecutor(jobs, get_context("forkserver"), initializer=_begin_process)
    try:
        yield pool
    except BaseException:
        for process in active_children():
            process.kill()
        closing = threading.Thread(target=pool.shutdown, daemon=True)
        closing.start()
        closing.join(POOL_S)
        raise
    pool.shutdown()


def _begin_process() -> None:
    """Leave it to the parent process when to stop, and end when it does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end_with_the_parent() -> None:
        if parent := parent_process():
            wait([parent.sentinel])
            os._exit(1)  # even while the core calculates

    threading.Thread(target=end_with_the_parent, name="parent", daemon=True).start()
