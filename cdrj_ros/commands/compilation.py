"""Compilation of the kernels that a start needs, if they are not on disk."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterable
from typing import Any, Final

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.compiled import kernels_are_compiled, kernels_can_be_kept
from cdrj_ros.model.loading import robot_path
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.shape import shape
from cdrj_ros.model.spatial_shape import shape_in_space
from cdrj_ros.robot.reader import load_document
from cdrj_ros.robot.space_reader import is_spatial
from cdrj_ros.robot.urdf import description_given

COMPILING: Final = "compiling the numerical kernels, up to a minute; kept for the next start ..."

OF_EVERY_START: Final = ("step", "geometry", "members")
"""Parts of ``compile_ahead`` that do not depend on one another; the longest one first."""

IN_SPACE: Final = "space"
"""Part of ``compile_ahead`` that only robots described in space need."""

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
    more = kernels_of_file(robot)
    if not kernels_are_compiled(shape, advance, *more):
        print(COMPILING, file=sys.stderr, flush=True)
        compile_for_start(*more)


def kernels_of_file(robot: str) -> tuple[Callable[..., Any], ...]:
    """Kernels that a robot file needs beyond those of every start, and that are not on disk.

    Args:
        robot: the file, or the name of an installed one; none if it is invalid, which is said when
            it is loaded.
    """
    if kernels_are_compiled(shape_in_space) or not _is_in_space(robot):
        return ()
    return (shape_in_space,)


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


def compile_for_start(*more: Callable[..., Any]) -> None:
    """Compile the kernels of a start in several processes, which takes half as long as in one.

    Where they fail or nothing can be kept, this process compiles what it needs when it needs it.

    Args:
        more: from ``kernels_of_file``.
    """
    parts = () if kernels_are_compiled(shape, advance) else OF_EVERY_START
    if more:
        parts = (*parts, IN_SPACE)
    if parts and kernels_can_be_kept(shape, advance, *more):
        compile_together(parts, quiet=True)


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
