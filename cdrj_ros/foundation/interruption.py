"""Ctrl-C ends a command at any moment: one line, exit code 130, within two seconds.

Python runs a signal handler between two byte codes of the main thread only.  An interrupt during a
kernel, a compilation or the wait for a thread pool would therefore come late, and one during an
import prints a traceback.  A watching thread sees the signal at once through the wakeup file
descriptor and ends the process if the main thread has not done so by itself.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Final, NoReturn

INTERRUPTED: Final = 130
"""Exit code after Ctrl-C, as shells have it: 128 and the number of SIGINT."""

GRACE_S: Final = 1.0
"""Time that the main thread has to end by itself after Ctrl-C [s]."""

SHOW_CURSOR: Final = "\x1b[?25h"
"""Progress bars hide it."""


class _Phase:
    """What an interrupt means at the moment; one a process, as signals are."""

    def __init__(self) -> None:
        self.loading = False
        """Nothing has to be cleaned up yet."""
        self.deferred = 0
        """Depth of ``deferring``."""
        self.announced = False
        """The line has been printed, or is being printed."""
        self.announcing = threading.RLock()
        """Held while the line is printed: no thread ends the process meanwhile."""


_PHASE = _Phase()


def announce_interruption(name: str) -> None:
    """Print the line that an interrupted command ends with, once."""
    with _PHASE.announcing:
        if _PHASE.announced:
            return
        _PHASE.announced = True
        shown = SHOW_CURSOR if os.isatty(2) else ""
        with suppress(OSError):  # nobody reads it
            os.write(2, f"{shown}{name}: interrupted\n".encode())


@contextmanager
def deferring() -> Iterator[None]:
    """While inside, the caller's own handler ends the command; the watching thread does not."""
    _PHASE.deferred += 1
    try:
        yield
    finally:
        _PHASE.deferred -= 1


def run_interruptibly(name: str, load: Callable[[], Callable[[], int]]) -> NoReturn:
    """Load a command and run it so that Ctrl-C ends it at any moment; exits.

    Args:
        name: of the command, for its line.
        load: imports the command and returns its ``main``.
    """
    _PHASE.loading = True

    def on_interrupt(_number: int, _frame: FrameType | None) -> None:
        if _PHASE.loading:
            _end(name)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, on_interrupt)
    _watch(name)
    sys.unraisablehook = _without_interrupts
    main = load()
    try:
        _PHASE.loading = False
        code = main()
    except KeyboardInterrupt:
        announce_interruption(name)
        code = INTERRUPTED
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


def _end(name: str) -> NoReturn:
    announce_interruption(name)
    os._exit(INTERRUPTED)


def _watch(name: str) -> None:
    """Start the thread that ends the process ``GRACE_S`` after an interrupt at the latest."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)

    def watch() -> None:
        ended = threading.Event()
        while number := os.read(reader, 1):
            if number[0] == signal.SIGINT and not _PHASE.deferred:
                if not _PHASE.loading:
                    ended.wait(GRACE_S)
                if not _PHASE.deferred:
                    _end(name)

    threading.Thread(target=watch, name="interrupts", daemon=True).start()


def _without_interrupts(event: Any) -> None:
    """Print what a destructor raised, as Python does, unless it was the interrupt."""
    if not issubclass(event.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(event)
