"""Tasks in several processes of this machine; the death of one does not affect the others."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable
from multiprocessing import forkserver, get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess, parent_process
from typing import Any, Final, Generic, TypeVar

from cdrj_ros.evaluation.tasks import Failed, Progress, Work, attempt

T = TypeVar("T")
R = TypeVar("R")

ATTEMPTS: Final = 2
"""A task is given up when this many processes have died while processing it."""

Kind = str
SHARE: Final[Kind] = "share"
RESULT: Final[Kind] = "result"


def in_processes(work: Work[T, R], jobs: int, report: Progress) -> list[R | Failed]:
    """Process tasks in ``jobs`` processes; arguments and results as for ``in_this_process``.

    Each process holds one task at a time, so a death is attributed to the right task.  A task whose
    process died is repeated once in another process.
    """
    return _Pool(work, jobs, report).results()


def prepare_processes(module: str) -> None:
    """Start the process from which others are forked, with a module that they need.

    Called before the caller's own imports, both import at the same time.
    """
    forkserver.set_forkserver_preload([module])
    forkserver.ensure_running()


class _Worker:
    """One process and the index of its task."""

    def __init__(self, context: Any, function: Callable[[Any, Progress], Any]) -> None:
        here, there = context.Pipe()
        self.connection: Connection = here
        self.process: BaseProcess = context.Process(
            target=_serve, args=(there, function), daemon=True
        )
        self.process.start()
        there.close()
        self.task: int | None = None

    def end(self) -> None:
        """Kill the process and close its connection."""
        self.process.kill()
        self.process.join()
        self.connection.close()


class _Pool(Generic[T, R]):
    """The state of one campaign."""

    def __init__(self, work: Work[T, R], jobs: int, report: Progress) -> None:
        self._work, self._report = work, report
        # a large task at the end would leave the other processes without work
        by_size = sorted(range(len(work.tasks)), key=lambda k: -work.sizes[k])
        self._waiting = deque(by_size)
        self._attempts = [0] * len(work.tasks)
        self._shares = [0.0] * len(work.tasks)
        self._found: dict[int, R | Failed] = {}
        self._jobs = min(jobs, len(work.tasks))
        self._workers: list[_Worker] = []
        self._context = get_context("forkserver")
        prepare_processes(work.function.__module__)

    def results(self) -> list[R | Failed]:
        """Process all tasks."""
        try:
            while len(self._found) < len(self._work.tasks):
                self._hand_out()
                busy = {worker.connection: worker for worker in self._workers}
                for connection in wait(list(busy)):
                    self._receive(busy[connection])  # type: ignore[index]
        finally:
            for worker in self._workers:
                worker.end()
        return [self._found[k] for k in range(len(self._work.tasks))]

    def _hand_out(self) -> None:
        """Give waiting tasks to idle processes, and start processes that are missing."""
        wanted = min(
            self._jobs, len(self._waiting) + sum(w.task is not None for w in self._workers)
        )
        while len(self._workers) < wanted:
            self._workers.append(_Worker(self._context, self._work.function))
        for worker in self._workers:
            if worker.task is None and self._waiting:
                worker.task = self._waiting.popleft()
                self._attempts[worker.task] += 1
                try:
                    worker.connection.send((self._work.tasks[worker.task], self._name(worker.task)))
                except OSError:
                    continue  # it died while idle; ``wait`` reports its connection next

    def _receive(self, worker: _Worker) -> None:
        """Receive one message of a process, or handle its death."""
        try:
            kind, value = worker.connection.recv()
        except (EOFError, OSError):
            self._bury(worker)
            return
        assert worker.task is not None
        if kind == SHARE:
            self._advance(worker.task, value)
            return
        self._finish(worker.task, value)
        worker.task = None

    def _bury(self, worker: _Worker) -> None:
        """Remove a dead process; queue its task again, or give the task up."""
        self._workers.remove(worker)
        worker.process.join(1.0)
        code = worker.process.exitcode
        worker.end()
        k = worker.task
        if k is None:
            return
        self._advance(k, 0.0)
        if self._attempts[k] < ATTEMPTS:
            self._waiting.append(k)
            return
        reason = f"{self._name(k)}: its process {_death(code)}, {ATTEMPTS} times in a row"
        self._finish(k, Failed(self._name(k), reason))

    def _finish(self, k: int, result: R | Failed) -> None:
        self._found[k] = result
        self._advance(k, 1.0)

    def _advance(self, k: int, share: float) -> None:
        self._shares[k] = share
        pairs = zip(self._shares, self._work.sizes, strict=True)
        self._report(sum(share * size for share, size in pairs))

    def _name(self, k: int) -> str:
        return self._work.names[k]


def _death(code: int | None) -> str:
    """How a process ended, in words."""
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        memory = " (out of memory?)" if name == "SIGKILL" else ""
        return f"was ended by {name}{memory}"
    return f"ended unexpectedly with code {code}"


def _serve(connection: Connection, function: Callable[[Any, Progress], Any]) -> None:
    """Process tasks until the parent process closes the connection or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process decides when to stop
    threading.Thread(target=_end_with_the_parent, name="parent", daemon=True).start()

    def on(share: float) -> None:
        connection.send((SHARE, share))

    while True:
        try:
            task, name = connection.recv()
            connection.send((RESULT, attempt(function, task, name, on)))
        except (EOFError, ConnectionError):  # the parent process has closed it, or has died
            return


def _end_with_the_parent() -> None:
    """End this process when its parent ends, even while the core calculates."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
