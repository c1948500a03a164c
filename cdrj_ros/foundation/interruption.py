"""Handling of Ctrl-C: a command ends within two seconds, with one line and exit code 130.

Python runs signal handlers only between two bytecode instructions of the main thread.  An interrupt
during a call of a compiled library or the wait for a thread pool would therefore be handled late,
and one during an import would print a traceback.  A watcher thread receives the signal immediately
through the wakeup file descriptor and ends the process if the main thread has not ended in time.
The installed executables start with SIGINT blocked, so that an interrupt while Python itself starts
waits until ``run_interruptibly`` can handle it.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Final, NoReturn

INTERRUPTED: Final = 130
"""Exit code after Ctrl-C, by the convention of shells: 128 plus the number of SIGINT."""

BLAS_THREADS: Final = "OPENBLAS_NUM_THREADS"
"""Environment variable with the number of threads of one operation of linear algebra."""

GRACE_S: Final = 1.0
"""Time for the main thread to end by itself after Ctrl-C [s]."""

DEFERRED_S: Final = 0.8
"""Additional time within ``deferring`` [s]."""

SHOW_CURSOR: Final = "\x1b[?25h"
"""Terminal sequence that shows the cursor, which progress bars hide."""


class _Phase:
    """The current handling of interrupts; one instance per process, because signals are global."""

    def __init__(self) -> None:
        self.loading = False
        """The command is being imported, so that no cleanup is needed."""
        self.code = INTERRUPTED
        """Exit code after an interrupt."""
        self.interrupted = False
        """Whether an interrupt has been raised as KeyboardInterrupt."""
        self.deferred = 0
        """Nesting depth of ``deferring``."""
        self.over = False
        """The command has ended; only its exit code is still to be returned."""
        self.restore: Callable[[], None] | None = None
        """Undoes a change of the terminal, see ``restoring``."""
        self.announced = False
        """Whether the line has been printed or is being printed."""
        self.announcing = threading.RLock()
        """Held while the line is printed, so that no thread ends the process meanwhile."""


_PHASE = _Phase()


def announce_interruption(name: str) -> None:
    """Print the final line of an interrupted command, once."""
    with _PHASE.announcing:
        if _PHASE.announced:
            return
        _PHASE.announced = True
        shown = SHOW_CURSOR if os.isatty(2) else ""
        with suppress(OSError):  # standard error may be closed
            os.write(2, f"{shown}{name}: interrupted\n".encode())


def was_interrupted() -> bool:
    """Whether Ctrl-C has been pressed; an error after it may be its consequence.

    A library may catch KeyboardInterrupt and fail later for the lack of what it was about to make.
    """
    return _PHASE.interrupted


@contextmanager
def deferring() -> Iterator[None]:
    """Give the caller ``DEFERRED_S`` longer to end the command by itself after an interrupt."""
    _PHASE.deferred += 1
    try:
        yield
    finally:
        _PHASE.deferred -= 1


@contextmanager
def restoring(restore: Callable[[], None]) -> Iterator[None]:
    """Call ``restore`` if the process is ended within the block without unwinding the stack."""
    before, _PHASE.restore = _PHASE.restore, restore
    try:
        yield
    finally:
        _PHASE.restore = before


def run_interruptibly(
    name: str, load: Callable[[], Callable[[], int]], interrupted: int = INTERRUPTED
) -> NoReturn:
    """Load and run a command, with Ctrl-C handled at any time, then exit.

    Args:
        name: name of the command, for the final line.
        load: function that imports the command and returns its ``main``.
        interrupted: exit code after Ctrl-C where ``main`` does not return one.
    """
    _PHASE.loading, _PHASE.code = True, interrupted

    def on_interrupt(_number: int, _frame: FrameType | None) -> None:
        if _PHASE.over:
            return
        if _PHASE.loading:
            _end(name)
        _PHASE.interrupted = True
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, on_interrupt)
    _watch(name)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    sys.unraisablehook = _without_interrupts
    main = _loaded(load)
    try:
        _PHASE.loading = False
        code = main()
        _PHASE.over = True
    except KeyboardInterrupt:
        _PHASE.over = True
        announce_interruption(name)
        code = interrupted
    except Exception:
        if not _PHASE.interrupted:
            raise
        announce_interruption(name)
        code = interrupted
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


def _loaded(load: Callable[[], Callable[[], int]]) -> Callable[[], int]:
    """The command, imported without searching for garbage, which took a fifth of the time.

    What it has imported lives as long as the process and is left out of all later searches.  Unless
    the user has chosen otherwise, NumPy calculates in one thread: with several, which took a fifth
    more processor time, the last digits depend on the number of processors.
    """
    os.environ.setdefault(BLAS_THREADS, "1")
    gc.disable()
    try:
        return load()
    finally:
        gc.freeze()
        gc.enable()


def _end(name: str) -> NoReturn:
    if _PHASE.restore is not None:
        _PHASE.restore()
    announce_interruption(name)
    os._exit(_PHASE.code)


def _watch(name: str) -> None:
    """Start the thread that ends the process if it has not ended in time after an interrupt."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)

    def watch() -> None:
        ended = threading.Event()
        while number := os.read(reader, 1):
            if number[0] == signal.SIGINT:
                if not _PHASE.loading:
                    ended.wait(GRACE_S)
                    if _PHASE.deferred:
                        ended.wait(DEFERRED_S)
                _end(name)

    threading.Thread(target=watch, name="interrupts", daemon=True).start()


def _without_interrupts(event: Any) -> None:
    """Report an exception from a destructor, as Python does, unless it is the interrupt."""
    if not issubclass(event.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(event)
