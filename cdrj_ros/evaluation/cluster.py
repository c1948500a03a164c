"""Tasks on a Dask cluster: one per recording, on machines with access to the same files."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from queue import Empty, Queue
from threading import Thread
from typing import Any, Final, TypeVar

from cdrj_ros import __version__
from cdrj_ros.evaluation.tasks import Failed, Progress, Work, attempt
from cdrj_ros.foundation.errors import UsageError

T = TypeVar("T")
R = TypeVar("R")

CONNECT_S: Final = 10.0
"""Time within which the scheduler must answer [s]."""

CLOSE_S: Final = 1.0
"""Time allowed for closing the connection [s]."""


def on_cluster(work: Work[T, R], address: str, report: Progress) -> list[R | Failed]:
    """Process tasks on the cluster of a scheduler; otherwise as ``in_this_process``.

    The scheduler repeats the task of a worker that died on another worker, as often as its setting
    ``distributed.scheduler.allowed-failures`` allows (3 by default).

    Args:
        work: the tasks.
        address: of the scheduler, such as ``tcp://10.0.0.5:8786``.
        report: called with the amount done, in the unit of the sizes.

    Raises:
        UsageError: Dask is not installed, or no scheduler answers at the address.
    """
    client = connected(address)
    try:
        return _gathered(client, work, report)
    finally:
        client.close(timeout=CLOSE_S)  # the scheduler drops the tasks of a closed client


def connected(address: str) -> Any:
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
    Thread(target=connect, daemon=True).start()
    try:
        found = answer.get(timeout=CONNECT_S + CLOSE_S)
    except Empty:
        found = TimeoutError("something else listens there")
    if isinstance(found, Exception):
        raise UsageError(
            f"--scheduler {address}: no Dask scheduler answered within {CONNECT_S:g} s "
            f"({' '.join(str(found).split())})"
        ) from found
    return found


def _gathered(client: Any, work: Work[T, R], report: Progress) -> list[R | Failed]:
    from distributed import as_completed

    call = partial(_remotely, __version__, work.function)
    futures = client.map(call, list(work.tasks), list(work.names), pure=False)
    index = {future.key: k for k, future in enumerate(futures)}
    found: dict[int, R | Failed] = {}
    suspects = []
    done = 0.0
    for future in as_completed(futures):
        k = index[future.key]
        if _killed_its_workers(future):
            suspects.append(k)
            continue
        found[k] = _result(future, work.names[k])
        future.release()  # lets the workers drop the result
        done += work.sizes[k]
        report(done)
    for k in suspects:  # one at a time: a worker's death counts against its waiting tasks too
        (future,) = client.map(call, [work.tasks[k]], [work.names[k]], pure=False)
        found[k] = _result(future, work.names[k])
        done += work.sizes[k]
        report(done)
    return [found[k] for k in range(len(futures))]


def _killed_its_workers(future: Any) -> bool:
    from distributed.scheduler import KilledWorker

    return future.status == "error" and isinstance(future.exception(), KilledWorker)


def _result(future: Any, name: str) -> Any:
    """Result of a task, or its ``Failed``."""
    try:
        return future.result()
    except Exception as error:  # noqa: BLE001  a worker or the scheduler died, not the task
        if future.status in ("cancelled", "lost"):
            return Failed(name, f"{name}: the connection to the scheduler was lost")
        if future.status == "error" and _killed_its_workers(future):
            return Failed(name, f"{name}: every worker that processed it died")
        return Failed(name, f"{name}: {_in_one_line(error)}")


def _in_one_line(error: object) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]


def _remotely(version: str, function: Callable[[T, Progress], R], task: T, name: str) -> R | Failed:
    """Process a task in a worker."""
    if version != __version__:
        return Failed(name, f"{name}: the worker has cdrj_ros {__version__}, not {version}")
    return attempt(function, task, name, _unheard)


def _unheard(share: float) -> None:
    del share


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
