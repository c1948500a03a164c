"""Calls on a Dask cluster that share large arguments, each of which is sent once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final, TypeVar
from warnings import catch_warnings, simplefilter

from cdrj_ros import __version__
from cdrj_ros.evaluation.cluster import CLOSE_S, connected
from cdrj_ros.evaluation.tasks import Failed, attempt
from cdrj_ros.foundation.errors import CdrjError

A = TypeVar("A")
B = TypeVar("B")
R = TypeVar("R")

ATTEMPTS: Final = 3
"""A call is given up when it has failed this often because workers died."""


class ClusterPool:
    """A pool whose ``map`` calls a function of two arguments on the workers."""

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
            CdrjError: the function failed, or a call was lost with every worker that tried it.
        """
        pairs = list(zip(small, large, strict=True))
        futures = [self._submit(function, *pair) for pair in pairs]
        return [
            self._result(future, function, *pair)
            for future, pair in zip(futures, pairs, strict=True)
        ]

    def _submit(self, function: Callable[[A, B], R], small: A, large: B) -> Any:
        if id(large) not in self._sent:
            # the scheduler gives the result of a task, unlike scattered data, to another worker
            # when one dies
            with catch_warnings():
                simplefilter("ignore")  # "Sending large graph"
                self._sent[id(large)] = large, self._client.submit(_kept, large, pure=False)
        there = self._sent[id(large)][1]
        return self._client.submit(_remotely, __version__, function, small, there, pure=False)

    def _result(self, future: Any, function: Callable[[A, B], R], small: A, large: B) -> Any:
        """Result of a call; if workers died, the argument is sent again and the call repeated."""
        reason = ""
        for _ in range(ATTEMPTS):
            try:
                result = future.result()
            except Exception as error:  # noqa: BLE001  a worker or the scheduler died
                reason = f"{type(error).__name__}: {' '.join(str(error).split())}"[:300]
                self._sent.pop(id(large), None)
                future = self._submit(function, small, large)
                continue
            if isinstance(result, Failed):
                raise CdrjError(result.reason)
            return result
        raise CdrjError(f"the cluster lost a call {ATTEMPTS} times: {reason}")


def _kept(argument: A) -> A:
    return argument


def _remotely(version: str, function: Callable[[A, B], R], small: A, large: B) -> R | Failed:
    """Call a function in a worker."""
    if version != __version__:
        return Failed("", f"a worker has cdrj_ros {__version__}, not {version}")
    return attempt(lambda pair, _: function(*pair), (small, large), "", lambda _: None)


@contextmanager
def cluster_pool(address: str) -> Iterator[ClusterPool]:
    """A pool on the cluster of a scheduler.

    Raises:
        UsageError: Dask is not installed, or no scheduler answers at the address.
    """
    client = connected(address)
    try:
        yield ClusterPool(client)
    finally:
        client.close(timeout=CLOSE_S)
