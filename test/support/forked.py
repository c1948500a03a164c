"""Executables as forks of one process that has imported what they need.

Most of the processor time of a short process is that of its imports.  What a user starts differs in
nothing else: the tests of starts, interrupts and ends start the installed executables.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from multiprocessing.reduction import DupFd
from pathlib import Path
from typing import Any

PATIENCE_S = 60.0
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(
    [
        f"cdrj_ros.nodes.{name}"
        for name in ("entry", "estimator", "markers", "replay", "rig", "watch")
    ]
)


class Forked:
    """An executable of ``cdrj_ros.nodes.entry`` with the interface of ``subprocess.Popen``."""

    def __init__(self, name: str, arguments: Sequence[str], output: int) -> None:
        """Start.

        Args:
            name: name of the executable.
            arguments: its arguments.
            output: file descriptor for its standard output and standard error.
        """
        self._command = [name, *map(str, arguments)]
        self._process = _SERVER.Process(
            target=_execute,
            args=(self._command, dict(os.environ), str(Path.cwd()), _Handed(output)),
            daemon=True,
        )
        self._process.start()
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """As of ``Popen``."""
        return self._process.exitcode

    def poll(self) -> int | None:
        """As of ``Popen``."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """As of ``Popen``."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(self._command, timeout or 0.0)
        return int(self._process.exitcode)

    def send_signal(self, number: int) -> None:
        """As of ``Popen``."""
        if self.poll() is None:
            os.kill(self._process.pid, number)

    def kill(self) -> None:
        """As of ``Popen``."""
        self._process.kill()


def end(process: Forked | subprocess.Popen[bytes]) -> None:
    """Interrupt a process as Ctrl-C does; kill it only if it does not end."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(PATIENCE_S)
    if process.poll() is None:
        process.kill()
        process.wait()


class Output:
    """What a process prints, read while it runs."""

    def __init__(self, stream: int) -> None:
        self.text = ""
        self._thread = threading.Thread(target=self._read, args=(stream,), daemon=True)
        self._thread.start()

    def _read(self, stream: int) -> None:
        decoder = codecs.getincrementaldecoder("utf-8")()  # a character may come in two pieces
        with contextlib.suppress(OSError):  # reading a closed terminal raises an error
            while data := os.read(stream, 65536):
                self.text += decoder.decode(data)

    def finish(self) -> str:
        """The whole, after the process has ended."""
        self._thread.join(PATIENCE_S)
        return self.text


class _Handed:
    """A file descriptor that the new process gets."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor

    def __reduce__(self) -> Any:
        return _taken, (DupFd(self.descriptor),)


def _taken(handed: Any) -> int:
    return int(handed.detach())


def _execute(command: list[str], environment: Mapping[str, str], folder: str, output: int) -> None:
    """Run the executable as its script does."""
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    for descriptor in (1, 2):
        os.dup2(output, descriptor)
    os.close(output)
    sys.stdout = io.TextIOWrapper(os.fdopen(1, "wb", closefd=False))
    sys.stderr = io.TextIOWrapper(
        os.fdopen(2, "wb", closefd=False), errors="backslashreplace", line_buffering=True
    )
    sys.argv = command
    from cdrj_ros.nodes import entry

    getattr(entry, command[0])()
