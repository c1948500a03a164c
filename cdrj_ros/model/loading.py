"""Loading of robot files, by path or by the name of an installed one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path

from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.foundation.output import printable
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.reader import build_robot, load_document


def load_model(path: str, preload: str | Sequence[float] | None = None) -> Model:
    """Read and prepare a robot file; a bare name means one of the installed ones.

    Args:
        path: the file, or the name of an installed robot.
        preload: preload of every cable [N], as numbers or as comma-separated text; None or empty
            keeps the preloads of the file.

    Raises:
        CdrjError: the file or the preloads are invalid; the message is one line.
    """
    document, source = load_document(robot_path(path))
    if not preload:
        return prepare(build_robot(document, source))
    try:
        values = [float(v) for v in (preload.split(",") if isinstance(preload, str) else preload)]
    except ValueError as error:
        raise UsageError(f"preload must be numbers separated by commas, got {preload!r}") from error
    cables = document["cables"]
    if len(values) != len(cables) or not all(0.0 <= value < 1e6 for value in values):
        raise UsageError(
            f"preload needs {len(cables)} tensions in [0, 1e6) N, one for each of "
            f"{', '.join(cable['name'] for cable in cables)}; got {preload!r}"
        )
    for cable, value in zip(cables, values, strict=True):
        cable["preload"] = value
    return prepare(build_robot(document, source))


def robot_path(path: str) -> Path:
    """Path of a robot file; a bare name means one of the installed ones.

    Raises:
        RobotFileError: no robot of that name is installed.
    """
    return installed_path(path, "robots", "robot file")


def installed_path(path: str, folder: str, kind: str) -> Path:
    """Path of a YAML file; a bare name means an installed one.

    Args:
        path: the file, or the name of one in the folder.
        folder: folder in the package's ``config``.
        kind: what such a file is called, for the error.

    Raises:
        RobotFileError: no file of that name is installed.
    """
    if not Path(path).exists() and "/" not in path and not path.endswith(".yaml"):
        folders = [config / folder for config in _installed_configs()]
        for place in folders:
            if (place / f"{path}.yaml").exists():
                return place / f"{path}.yaml"
        names = sorted({file.stem for place in folders for file in place.glob("*.yaml")})
        close = get_close_matches(path, names, n=1)
        nearest = f"; did you mean {close[0]}?" if close else ""
        raise RobotFileError(
            f"there is no {kind} {printable(path)}, and none of that name is installed{nearest}"
        )
    return Path(path)


def _installed_configs() -> Iterator[Path]:
    """Folders that may hold the package's own files: beside the source, or installed."""
    here = Path(__file__).resolve()
    yield here.parents[2] / "config"
    for parent in here.parents:
        yield parent / "share" / "cdrj_ros" / "config"
