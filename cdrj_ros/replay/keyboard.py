"""Read single keys from a terminal without Enter, and always restore its settings."""

from __future__ import annotations

import atexit
import contextlib
import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator
from types import FrameType
from typing import Any, Final

SEQUENCES: Final = {
    b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left",
    b"\x1bOA": "up", b"\x1bOB": "down", b"\x1bOC": "right", b"\x1bOD": "left",
}  # fmt: skip
"""Byte sequences of the arrow keys."""


class Keyboard:
    """Reads the pressed keys; none unless this process controls the terminal."""

    def __init__(self, descriptor: int | None = None) -> None:
        """Store the descriptor; only ``listening`` changes the terminal's settings."""
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._before: list[Any] | None = None
        self._rest = b""

    @contextlib.contextmanager
    def listening(self) -> Iterator[bool]:
        """Enable the reading of single keys; yields whether there is a terminal to read from."""
        if not self._is_ours():
            yield False
            return
        self._before = termios.tcgetattr(self._descriptor)
        atexit.register(self._restore)
        continued = signal.signal(signal.SIGCONT, self._on_continue)
        stopped = signal.signal(signal.SIGTSTP, self._on_stop)
        try:
            tty.setcbreak(self._descriptor)
            yield True
        finally:
            signal.signal(signal.SIGTSTP, stopped)
            signal.signal(signal.SIGCONT, continued)
            self._restore()
            atexit.unregister(self._restore)

    def read(self) -> list[str]:
        """Keys in the order pressed: ``up``, ``down``, ``left``, ``right``, or the character."""
        if self._before is None:
            return []
        text, self._rest = self._rest, b""
        while select.select([self._descriptor], [], [], 0.0)[0]:
            try:
                more = os.read(self._descriptor, 64)
            except OSError:  # in the background, or the terminal has been closed
                break
            if not more:
                break
            text += more
        return self._split(text)

    def _split(self, text: bytes) -> list[str]:
        keys = []
        while text:
            if text[:3] in SEQUENCES:
                keys.append(SEQUENCES[text[:3]])
                text = text[3:]
            elif text in (b"\x1b[", b"\x1bO"):
                self._rest = text  # wait for the rest of an arrow key's sequence
                break
            else:
                keys.append(text[:1].decode("ascii", "replace"))
                text = text[1:]
        return keys

    def _is_ours(self) -> bool:
        """Whether this is a terminal with this process in the foreground."""
        try:
            return os.isatty(self._descriptor) and os.tcgetpgrp(self._descriptor) == os.getpgrp()
        except OSError:
            return False

    def _restore(self) -> None:
        if self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._before = None

    def _on_stop(self, _number: int, _frame: FrameType | None) -> None:
        """Handle Ctrl-Z: restore the terminal, since not every shell does."""
        if self._before is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
        os.kill(os.getpid(), signal.SIGSTOP)

    def _on_continue(self, _number: int, _frame: FrameType | None) -> None:
        """Handle `fg` after Ctrl-Z: enable the reading of single keys again."""
        if self._before is not None and self._is_ours():
            tty.setcbreak(self._descriptor)
