"""A pool of threads whose work is abandoned when the block that uses it fails."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def thread_pool(workers: int) -> Iterator[ThreadPoolExecutor]:
    """A pool of ``workers`` threads for the block.

    ``ThreadPoolExecutor`` itself waits for everything submitted, also after an error or Ctrl-C.
    This pool drops what has not begun, and does not wait for what has.
    """
    pool = ThreadPoolExecutor(workers)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()
