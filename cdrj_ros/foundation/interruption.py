"""Handling of Ctrl-C: a command ends within two seconds, with one line and exit code 130.

Python raises ``KeyboardInterrupt`` between two instructions of the main thread, and the compiled
core looks for it between some hundred samples.  Work in other threads is not waited for.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from importlib import import_module
from traceback import clear_frames
from types import FrameType
from typing import Final, NoReturn

INTERRUPTED: Final = 130
"""Exit code after Ctrl-C, by the convention of shells: 128 plus the number of SIGINT."""

BLAS_THREADS: Final = "OPENBLAS_NUM_THREADS"
"""Environment variable with the number of threads of one operation of linear algebra."""


def announce_interruption(name: str) -> None:
    """Print the final line of an interrupted command."""
    with suppress(OSError):  # standard error may be closed
        os.write(2, f"{name}: interrupted\n".encode())


def run_interruptibly(
    name: str, load: Callable[[], Callable[[], int]], interrupted: int = INTERRUPTED
) -> NoReturn:
    """Load and run a command, then exit.

    Unless the user has chosen otherwise, NumPy calculates in one thread: with several, which took a
    fifth more processor time, the last digits depend on the number of processors.

    Args:
        name: name of the command, for the line after Ctrl-C.
        load: function that imports the command and returns its ``main``.
        interrupted: exit code after Ctrl-C where ``main`` does not return one.
    """
    os.environ.setdefault(BLAS_THREADS, "1")

    def end(_number: int = signal.SIGINT, _frame: FrameType | None = None) -> NoReturn:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        announce_interruption(name)
        os._exit(interrupted)  # without waiting for work in other threads

    # Compiled modules turn a KeyboardInterrupt during their import into an ImportError.
    signal.signal(signal.SIGINT, end)
    main = load()
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        code = main()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    except KeyboardInterrupt as error:
        clear_frames(error.__traceback__)  # lets go of what would be reported as leaked
        end()
    sys.exit(code)


def run_module(name: str, module: str, interrupted: int = INTERRUPTED) -> NoReturn:
    """``run_interruptibly`` for the ``main`` of a module, which is imported by its name."""
    run_interruptibly(name, lambda: import_module(module).main, interrupted)


@contextmanager
def thread_pool(workers: int) -> Iterator[ThreadPoolExecutor]:
    """A pool of ``workers`` threads for the block.

    ``ThreadPoolExecutor`` itself waits for everything submitted, also after an error or Ctrl-C.
    This pool drops what has not begun, and does not wait for what has.
    """
    pool = ThreadPoolExecutor(workers)
    try:
        yield pool
        pool.shutdown()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
