"""Compilation of the kernels that every start needs, if they are not on disk."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from typing import Final

from cdrj_ros.model.compiled import kernels_are_compiled, kernels_can_be_kept
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.shape import shape

COMPILING: Final = "compiling the numerical kernels, up to a minute; kept for the next start ..."

OF_EVERY_START: Final = ("step", "geometry", "members")
"""Parts of ``compile_ahead`` that do not depend on one another; the longest one first."""

_PROGRAM: Final = """
import sys
sys.path[:] = {path!r}
from cdrj_ros.commands.compile_ahead import compile_part
compile_part({part!r})
"""


def ensure_compilation() -> None:
    """Compile the kernels of every start, with a notice, unless they are on disk."""
    if not kernels_are_compiled(shape, advance):
        print(COMPILING, file=sys.stderr, flush=True)
        compile_for_start()


def compile_for_start() -> None:
    """Compile the kernels of every start in several processes, which takes half as long as in one.

    Where they fail or nothing can be kept, this process compiles what it needs when it needs it.
    """
    if not kernels_are_compiled(shape, advance) and kernels_can_be_kept(shape, advance):
        compile_together(OF_EVERY_START, quiet=True)


def compile_together(parts: Iterable[str], *, quiet: bool = False) -> bool:
    """Compile parts at once, in processes of their own, which end with this one at the latest.

    Args:
        parts: keys of ``compile_ahead.PARTS``.
        quiet: whether the processes report nothing.

    Returns:
        Whether all succeeded.
    """
    path, silence = list(sys.path), subprocess.DEVNULL if quiet else None
    running: list[subprocess.Popen[bytes]] = []
    try:
        for part in parts:
            command = [sys.executable, "-c", _PROGRAM.format(path=path, part=part)]
            running.append(
                subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silence, stderr=silence)
            )
        codes = [process.wait() for process in running]
        return not any(codes)
    except OSError:  # no further process can be started
        return False
    finally:
        for process in running:
            process.kill()
            process.communicate()
