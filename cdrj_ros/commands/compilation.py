"""Compilation of the kernels that a start needs, if they are not on disk."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterable
from typing import Final

from cdrj_ros.commands.parts import IN_SPACE, OF_EVERY_START, is_compiled
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.compiled import kernels_can_be_kept
from cdrj_ros.model.loading import robot_path
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.shape import shape
from cdrj_ros.robot.reader import load_document
from cdrj_ros.robot.space_reader import is_spatial
from cdrj_ros.robot.urdf import description_given

COMPILING: Final = "compiling the numerical kernels, up to a minute; kept for the next start ..."

_PROGRAM: Final = """
import sys
sys.path[:] = {path!r}
from cdrj_ros.commands.compile_ahead import compile_part
compile_part({part!r})
"""


def ensure_compilation(robot: str) -> None:
    """Compile the kernels that a start needs, with a notice, unless they are on disk.

    Args:
        robot: the robot file, or the name of an installed one.
    """
    compile_for_estimates(robot, lambda: print(COMPILING, file=sys.stderr, flush=True))


def parts_of_file(robot: str) -> tuple[str, ...]:
    """Parts that a robot file needs beyond those of every start, and that are not on disk.

    Args:
        robot: the file, or the name of an installed one; none if it is invalid, which is said when
            it is loaded.
    """
    return (IN_SPACE,) if not is_compiled(IN_SPACE) and _is_in_space(robot) else ()


class _UrdfNamedError(Exception):
    """A robot file names the URDF of the robot description."""


def _is_in_space(robot: str) -> bool:
    """Whether a robot file describes a robot in space, as all with a URDF do."""

    def not_yet() -> str:
        raise _UrdfNamedError

    try:
        with description_given(not_yet):
            return is_spatial(load_document(robot_path(robot))[0])
    except _UrdfNamedError:
        return True
    except CdrjError:
        return False


def compile_for_estimates(robot: str, announce: Callable[[], object]) -> None:
    """Compile the kernels that a robot's estimates need.

    Several processes take half as long as one.  Where one of them fails or nothing can be kept,
    this process compiles what it needs when it needs it.

    Args:
        robot: the robot file, or the name of an installed one.
        announce: called before a wait.
    """
    needed = (*missing(OF_EVERY_START), *parts_of_file(robot))
    if needed:
        announce()
        if kernels_can_be_kept(shape, advance):
            compile_together(needed, quiet=True)


def missing(parts: Iterable[str]) -> tuple[str, ...]:
    """Those of the parts whose kernels are not on disk."""
    return tuple(part for part in parts if not is_compiled(part))


def compile_together(parts: Iterable[str], *, quiet: bool = False) -> bool:
    """Compile parts at once, in processes of their own, which end with this one at the latest.

    Args:
        parts: keys of ``compile_ahead.PARTS``.
        quiet: whether the processes report nothing.

    Returns:
        Whether all succeeded.
    """
    with Compilation(parts, quiet=quiet) as compilation:
        return compilation.succeeds()


class Compilation:
    """Processes that compile a part each; they end with this one at the latest."""

    def __init__(self, parts: Iterable[str], *, quiet: bool = False) -> None:
        """Start the processes.

        Args:
            parts: keys of ``compile_ahead.PARTS``.
            quiet: whether the processes report nothing.
        """
        self.parts = tuple(parts)
        path, silence = list(sys.path), subprocess.DEVNULL if quiet else None
        self._running: list[subprocess.Popen[bytes]] = []
        self._failed = False
        try:
            for part in self.parts:
                program = _PROGRAM.format(path=path, part=part)
                command = [sys.executable, "-c", program]
                self._running.append(
                    subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silence, stderr=silence)
                )
        except OSError:  # no further process can be started
            self._failed = True
            self.end()

    def __enter__(self) -> Compilation:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def runs(self) -> bool:
        """Whether a process still runs."""
        return any(process.poll() is None for process in self._running)

    def succeeds(self) -> bool:
        """Wait for the processes; True if all parts have been compiled."""
        codes = [process.wait() for process in self._running]
        return not self._failed and not any(codes)

    def end(self) -> None:
        """End the processes that still run."""
        for process in self._running:
            process.kill()
            process.communicate()
