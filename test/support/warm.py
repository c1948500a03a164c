"""Python programs as forks of one process that has imported NumPy and numba, but nothing of ours.

Importing the two takes most of the time of a short program; so do the modules that numba imports
when it compiles for the first time.  Programs differ in nothing else: each
has its own environment, folder and output, and reads the package from the folder that it is given.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

SERVER = """
import os, pickle, sys, traceback
import numba, numba.core.event, numpy
import numba.experimental, numba.np.arraymath, numba.np.linalg, numba.np.npyimpl, numba.typed
from numba.core.registry import cpu_target

cpu_target.typing_context.refresh()

def run(folder, program, environment):
    os.environ.clear()
    os.environ.update(environment)
    numba.config.reload_config()
    os.chdir(folder)
    sys.path[0] = folder
    try:
        exec(compile(program, "<string>", "exec"), {"__name__": "__main__"})
    except BaseException:
        traceback.print_exc()
        return 1
    return 0

while True:
    try:
        wanted = pickle.load(sys.stdin.buffer)
    except EOFError:
        break
    ends = os.pipe(), os.pipe()
    child = os.fork()
    if child == 0:
        for number, end in zip((1, 2), ends):
            os.dup2(end[1], number)
        code = run(*wanted)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])  # what they print fits into a pipe
    said = []
    for end in ends:
        os.close(end[1])
        with open(end[0]) as file:
            said.append(file.read())
    pickle.dump((code, *said), sys.stdout.buffer)
    sys.stdout.buffer.flush()
"""


class Ended(NamedTuple):
    """As of ``subprocess``."""

    returncode: int
    stdout: str
    stderr: str


class Programs:
    """Runs programs one after the other."""

    def __init__(self, server: subprocess.Popen[bytes]) -> None:
        self._server = server

    def run(self, folder: Path, program: str, environment: Mapping[str, str]) -> Ended:
        """Run a program in a folder whose packages it imports first; it prints a few lines."""
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        pickle.dump((str(folder), program, dict(environment)), self._server.stdin)
        self._server.stdin.flush()
        return Ended(*pickle.load(self._server.stdout))  # noqa: S301 - of the process above


@contextmanager
def warm_programs() -> Iterator[Programs]:
    """The process that is forked."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    with subprocess.Popen(
        [sys.executable, "-c", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=kept
    ) as server:
        yield Programs(server)
        assert server.stdin is not None
        server.stdin.close()
        assert server.wait(60.0) == 0
