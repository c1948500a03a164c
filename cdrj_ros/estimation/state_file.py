"""State files: the memory of an estimator, so that a restart continues the last run."""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from time import time_ns
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.breaks import EarlierRun
from cdrj_ros.estimation.estimator import State
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.files import InputError, read_regular, write_bytes
from cdrj_ros.foundation.output import printable
from cdrj_ros.model.prepared import Model

KIND: Final = b"cdrj_ros state "
"""First bytes of a state file of any version."""

HEADER: Final = KIND + b"12\n"
"""First line of a state file."""

MAXIMUM_BYTES: Final = 50_000_000
"""Maximum size of a state file; a larger file is refused."""

DAY_NS: Final = 86_400_000_000_000
"""A day [ns]."""


class StateFileError(CdrjError):
    """A state file that cannot be used; the estimator starts without it."""


def _digest(model: Model) -> NDArray[np.uint8]:
    """Digest of topology and constants, without which a state is meaningless."""
    digest = hashlib.sha256(b"cdrj_ros state 3")
    digest.update(model.topology.tobytes())
    digest.update(model.constants.tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)


def _is_of(model: Model, arrays: Mapping[str, NDArray[Any]], key: str) -> bool:
    """Whether the digest in a state file is that of a robot."""
    return key in arrays and np.array_equal(arrays[key], _digest(model))


def _set_by_services(model: Model) -> set[str]:
    """Paths of the numbers that ``~/tare`` and ``~/set_preload`` set."""
    layout = model.layout
    return {
        *(f"motors.{name}.reference_angle" for name in layout.motors),
        *(f"joints.{name}.reference_angle" for name in layout.joints),
        *(f"cables.{cable.name}.preload" for cable in model.robot.cables),
    }


def with_checksum(content: bytes) -> bytes:
    """The content of a state file: a header line, a checksum, then the arrays."""
    return HEADER + hashlib.sha256(content).digest() + content


def _arrays(content: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """The arrays in a state file.

    Raises:
        StateFileError: not a state file, or damaged.
    """
    body = content[len(HEADER) + hashlib.sha256().digest_size :]
    if not content.startswith(HEADER):
        raise StateFileError(f"{path} is not a state file of this version")
    if with_checksum(body) != content:
        raise StateFileError(f"{path} is damaged: its checksum does not fit its content")
    try:
        with np.load(BytesIO(body), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise StateFileError(f"{path} is not a state file: {printable(str(error))}") from error


def _unpacked(array: NDArray[Any]) -> Any:
    """The value that ``_packed`` has packed.

    Raises:
        ValueError: not JSON.
    """
    try:
        return json.loads(array.tobytes())
    except RecursionError as error:
        raise ValueError("too deeply nested") from error


def _packed(value: Any) -> NDArray[np.uint8]:
    """A value as JSON, in an array that a state file can hold."""
    return np.frombuffer(json.dumps(value).encode(), dtype=np.uint8)


def write_state(live: LiveEstimator, path: Path) -> bool:
    """Write an estimator's memory atomically: a crash leaves the old file or the new one.

    The file holds the state and the reference angles and preloads set at run time; only the latter
    if no sample has been processed since they were set.

    Returns:
        False if there is nothing to write yet.

    Raises:
        StateFileError: the file cannot be written.
    """
    if live.sample is None and not live.changes:
        return False
    arrays: dict[str, NDArray[Any]] = {
        "robot": _digest(live.started),
        "changes": _packed(live.changes),
    }
    if live.sample is not None:
        arrays |= {
            "digest": _digest(live.model),
            "stamp": np.array([live.state.stamp_ns]),
            "state": live.state.values,
            "motor_angle": live.sample.motor_angle,
            "joint_angle": live.sample.joint_angle,
            "last_tension": live.last_tension,
        }
        arrays |= live.conditioner.memory()
        if live.corrections is not None:
            arrays["beliefs"] = _packed(live.corrections.memory())
        if live.ensemble is not None:
            arrays |= live.ensemble.memory()
    buffer = BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    try:
        _check_replaceable(path)
        write_bytes(path, with_checksum(buffer.getvalue()))
    except OSError as error:
        raise StateFileError(f"cannot write the state file {path}: {error.strerror}") from error
    return True


def _check_replaceable(path: Path) -> None:
    """Refuse to write to what is no state file.

    Raises:
        StateFileError: a file of another kind, such as the robot file; or a pipe, which takes
            nothing, for ever, if nobody reads it.
        OSError: the file cannot be read.
    """
    if not path.exists():
        return
    if not path.is_file():
        raise StateFileError(f"cannot write the state file {path}: it is not a regular file")
    with path.open("rb") as file:
        begin = file.read(len(KIND))
    if begin not in (b"", KIND):
        raise StateFileError(f"{path} is not a state file, and is not replaced")


def read_state(live: LiveEstimator, path: Path) -> str:
    """Restore an estimator from a file.

    Reference angles and preloads are restored even if the state itself is refused afterwards.

    Returns:
        A description of what was restored; empty if there is no such file.

    Raises:
        StateFileError: the file is not a usable state file, or belongs to another robot.
    """
    try:
        content = read_regular(path, MAXIMUM_BYTES)
    except InputError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            return ""
        raise StateFileError(f"cannot read the state file {path}: {error}") from error
    arrays = _arrays(content, path)
    if not _is_of(live.started, arrays, "robot"):
        raise StateFileError(f"{path} belongs to another robot, or to other parameters")
    words = _take_up_changes(live, arrays, path)
    if "state" not in arrays:
        return f"{words} from {path}; the state itself is unknown"
    if not _is_of(live.model, arrays, "digest"):
        said = f"{words} taken up; " if words else ""
        raise StateFileError(f"{said}the state in {path} belongs to other friction")
    _take_up_state(live, arrays, path)
    said = f", with {words}" if words else ""
    days = (int(arrays["stamp"][0]) - time_ns()) / DAY_NS
    if abs(days) > 1.0:
        side = "after" if days > 0.0 else "before"
        said += f"; its last estimate is {abs(days):.0f} days {side} the time of this computer"
    return f"continues from {path}{said}"


def _take_up_state(live: LiveEstimator, arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Restore the state, the ensemble and the sensors whose corrections the state contains.

    Raises:
        StateFileError: the content is unusable; the state has not changed then.
    """
    values, stamp = arrays["state"], arrays.get("stamp")
    if values.dtype != np.float64 or not live.model.core.is_state(values):
        raise StateFileError(f"{path} holds no usable state")
    if stamp is None or stamp.shape != (1,) or stamp.dtype != np.int64 or stamp[0] <= 0:
        raise StateFileError(f"{path} holds no stamp")
    known = live.conditioner.memory()
    known["motor_angle"] = np.empty(len(live.model.robot.motors))
    known["joint_angle"] = np.empty(len(live.model.robot.joints))
    known["last_tension"] = np.empty(len(live.model.layout.elements))
    for name, own in known.items():
        there = arrays.get(name)
        if there is None or there.shape != own.shape or there.dtype != own.dtype:
            raise StateFileError(f"{path} holds no usable {name.replace('_', ' ')}")
    if "beliefs" in arrays and live.ensemble is not None:
        live.begin_corrections()
        assert live.corrections is not None
        try:
            live.corrections.recall(_unpacked(arrays["beliefs"]))
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            live.corrections.forget()
            raise StateFileError(f"{path} holds no usable beliefs: {error}") from error
    if live.ensemble is not None and not live.ensemble.recall(arrays):
        live.ensemble.reset()
    state = State(int(stamp[0]), values)
    live.conditioner.recall(arrays)
    angles = arrays["motor_angle"], arrays["joint_angle"]
    live.resume(EarlierRun(state, *angles, arrays["last_tension"]))


def _take_up_changes(live: LiveEstimator, arrays: Mapping[str, NDArray[Any]], path: Path) -> str:
    """Restore reference angles and preloads that the earlier run set; returns a description.

    Raises:
        StateFileError: the changes are unusable; nothing has changed then.
    """
    try:
        changes = _unpacked(arrays["changes"])
        if not changes:
            return ""
        if not _set_by_services(live.model).issuperset(changes):
            raise ValueError("numbers that no service sets")
        live.change({name: float(value) for name, value in changes.items()})
    except (KeyError, TypeError, ValueError, AttributeError, CdrjError) as error:
        raise StateFileError(f"{path} holds no usable changes: {error}") from error
    return ", ".join(f"{name} = {value:g}" for name, value in live.changes.items())
