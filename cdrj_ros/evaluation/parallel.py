"""One task per recording, run here, in processes of this machine, or on a Dask cluster.

A task has the same input wherever it runs, and the results keep the order of the tasks; they are
therefore identical to the last digit. A task that fails, or whose process dies, does not stop the
others: its result is a ``Failed``.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, forkserver, get_context
from multiprocessing.connection import wait
from multiprocessing.process import parent_process
from queue import Empty, Queue
from typing import Any, Final, Generic, TypeVar

from cdrj_ros import __version__
from cdrj_ros.foundation.errors import CdrjError, UsageError

A = TypeVar("A")
B = TypeVar("B")
T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[float], None]

WORTH_PROCESSES: Final = 16 * 1024 * 1024
"""Total size of recordings above which additional processes save time despite their start [B]."""

ATTEMPTS: Final = 3
"""A call on a cluster is given up when it has failed this often because workers died."""

CONNECT_S: Final = 10.0
"""Time within which a scheduler must answer [s]."""

POOL_S: Final = 10.0
"""Time allowed for closing a pool whose processes have been ended [s]."""

CLOSE_S: Final = 1.0
"""Time allowed for closing the connection to a scheduler [s]."""


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
    kind: type[R]
    """Of every result; a worker that returns anything else has failed."""


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0))


def default_jobs(sizes: Sequence[int]) -> int:
    """Number of processes that pay off for recordings of these sizes [B]."""
    if sum(sizes) < WORTH_PROCESSES:
        return 1
    return max(1, min(processors(), len(sizes)))


def reason_of(error: BaseException) -> str:
    """Why a task failed, in one line."""
    if isinstance(error, CdrjError):
        return str(error)
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror or error}"
    return f"unexpected {type(error).__name__}: {' '.join(str(error).split())}"


def in_this_process(work: Work[T, R], report: Progress) -> list[R | Failed]:
    """Process the tasks one after another.

    Args:
        work: the tasks.
        report: called with the amount done, in the unit of the sizes.
    """
    results: list[R | Failed] = []
    for task, name, size in zip(work.tasks, work.names, work.sizes, strict=True):
        results.append(_attempt(work.function, task, name))
        report(sum(work.sizes[: len(results) - 1]) + size)
    return results


def in_processes(work: Work[T, R], jobs: int, report: Progress) -> list[R | Failed]:
    """As ``in_this_process``, but ``jobs`` tasks at a time, each in a process of this machine."""
    forkserver.set_forkserver_preload([work.function.__module__])
    return _in_executor(work, partial(_processes, jobs), report)


def on_cluster(work: Work[T, R], address: str, report: Progress) -> list[R | Failed]:
    """As ``in_this_process``, but on the Dask cluster of the scheduler at an address.

    Raises:
        UsageError: Dask is not installed, no scheduler answers, or a worker has another version.
    """
    with connected(address) as client:
        executor = client.get_executor(pure=False)
        return _in_executor(work, lambda: nullcontext(executor), report)


def _attempt(function: Callable[[T], R], task: T, name: str) -> R | Failed:
    """Process one task; an exception becomes its ``Failed``."""
    try:
        return function(task)
    except Exception as error:  # noqa: BLE001  one failure must not stop the other tasks
        return Failed(name, reason_of(error))


def _in_executor(
    work: Work[T, R], opened: Callable[[], AbstractContextManager[Executor]], report: Progress
) -> list[R | Failed]:
    """Process the tasks, large ones first: at the end they would leave other processes idle.

    The death of a process may also cost tasks that were waiting; they are then tried one by one.
    """
    order = sorted(range(len(work.tasks)), key=lambda k: -work.sizes[k])
    found: dict[int, R | Failed] = {}

    def note(k: int, result: R | Failed) -> None:
        if not isinstance(result, (work.kind, Failed)):
            reason = f"{work.names[k]}: a worker returned {type(result).__name__}"
            result = Failed(work.names[k], f"{reason}, not {work.kind.__name__}")
        found[k] = result
        report(sum(work.sizes[k] for k in found))

    with opened() as executor:
        futures = {
            executor.submit(_attempt, work.function, work.tasks[k], work.names[k]): k for k in order
        }
        for future in as_completed(futures):
            if future.exception() is None:
                note(futures[future], future.result())
    for k in sorted(set(order) - set(found)):
        with opened() as executor:
            future = executor.submit(_attempt, work.function, work.tasks[k], work.names[k])
            if future.exception() is None:
                note(k, future.result())
            else:
                reason = f"{work.names[k]}: its process died, twice (out of memory?)"
                note(k, Failed(work.names[k], reason))
    return [found[k] for k in range(len(work.tasks))]


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


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of the scheduler at an address; raises as ``on_cluster``."""
    try:
        from distributed import Client
    except ImportError as error:
        raise UsageError(
            "--scheduler needs Dask: pip install 'cdrj_ros[cluster]' or 'distributed'"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # failures are reported by name
    answer: Queue[Any] = Queue()

    def connect() -> None:
        try:
            answer.put(Client(address, timeout=CONNECT_S))
        except Exception as error:  # noqa: BLE001  whatever the port sent instead of an answer
            answer.put(error)

    # Dask waits without end for a port that accepts a connection and says nothing
    threading.Thread(target=connect, daemon=True).start()
    try:
        client = answer.get(timeout=CONNECT_S + CLOSE_S)
    except Empty:
        client = TimeoutError("something else listens there")
    if isinstance(client, Exception):
        raise UsageError(
            f"--scheduler {address}: no Dask scheduler answered within {CONNECT_S:g} s "
            f"({' '.join(str(client).split())})"
        ) from client
    try:
        for worker, version in client.run(_version).items():
            if version != __version__:
                raise UsageError(f"{worker} has cdrj_ros {version}, not {__version__}")
        yield client
    finally:
        client.close(timeout=CLOSE_S)  # the scheduler drops the tasks of a closed client


def _version() -> str:
    return __version__


class ClusterPool:
    """A pool whose ``map`` calls a function of two arguments on the workers of a cluster."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._sent: dict[int, tuple[object, Any]] = {}
        """Large arguments and their copies on the cluster, by identity."""

    def map(self, function: Callable[[A, B], R], small: Sequence[A], large: Sequence[B]) -> list[R]:
        """The results for all pairs, in order.

        Args:
            function: importable by name on the workers.
            small: first arguments, sent with every call.
            large: second arguments; each object is sent once and kept until the pool is closed.

        Raises:
            CdrjError: of the function, or the calls were lost with the workers that tried them.
        """
        reason = ""
        for _ in range(ATTEMPTS):
            try:
                there = [self._copy(one) for one in large]
                calls = self._client.map(function, small, there, pure=False)
                return list(self._client.gather(calls))
            except CdrjError:
                raise
            except Exception as error:  # noqa: BLE001  a worker died, and what it held is lost
                self._sent.clear()
                reason = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
        raise CdrjError(f"the cluster lost a call {ATTEMPTS} times: {reason}")

    def _copy(self, large: object) -> Any:
        if id(large) not in self._sent:
            self._sent[id(large)] = large, self._client.scatter(large, hash=False)
        return self._sent[id(large)][1]


@contextmanager
def cluster_pool(address: str) -> Iterator[ClusterPool]:
    """A pool on the cluster of a scheduler; raises as ``on_cluster``."""
    with connected(address) as client:
        yield ClusterPool(client)


def check_address(address: str) -> None:
    """Check the form of a scheduler's address.

    Raises:
        UsageError: no scheduler can have this address.
    """
    scheme, _, rest = address.rpartition("://")
    host, _, port = rest.rpartition(":")
    if scheme not in ("", "tcp", "tls", "ws", "wss", "ucx") or not host or not port.isdecimal():
        raise UsageError(
            f"--scheduler must be the address of a Dask scheduler, such as tcp://10.0.0.5:8786, "
            f"got {address!r}"
        )
