"""What an estimator knows, in a file, so that a restart goes on where the last run ended."""

from __future__ import annotations

import hashlib
import json
import re
import zipfile
import zlib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import State
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.files import write_bytes
from cdrj_ros.foundation.text import printable
from cdrj_ros.model.prepared import Model

HEADER: Final = b"cdrj_ros state 4\n"
"""How a state file begins."""

MAXIMUM_BYTES: Final = 50_000_000
"""A state file is small; more is not one."""

CHANGED: Final = re.compile(r"(motors|joints)\.\w+\.reference_angle|cables\.\w+\.preload")
"""Paths of the numbers that ``~/tare`` and ``~/set_preload`` set."""


class StateFileError(CdrjError):
    """A state file that cannot be used; the estimator starts without it."""


def _digest(model: Model) -> NDArray[np.uint8]:
    """Of everything that a state only makes sense with."""
    digest = hashlib.sha256(b"cdrj_ros state 2")
    digest.update(model.plan.tobytes())
    digest.update(model.numbers.tobytes())
    return np.frombuffer(digest.digest(), dtype=np.uint8)


def with_checksum(content: bytes) -> bytes:
    """The content of a state file: a line of its format, a checksum, then the arrays."""
    return HEADER + hashlib.sha256(content).digest() + content


def _arrays(content: bytes, path: Path) -> dict[str, NDArray[Any]]:
    """The arrays in a state file.

    Raises:
        StateFileError: the file is something else, or has changed since it was written.
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


def _packed(value: Any) -> NDArray[np.uint8]:
    """A value as JSON, in an array that a state file can hold."""
    return np.frombuffer(json.dumps(value).encode(), dtype=np.uint8)


def write_state(live: LiveEstimator, path: Path) -> bool:
    """Write what an estimator knows, all or nothing: a crash leaves the old file or the new one.

    That is its state, and the reference angles and preloads that were set while it ran; these alone
    where they were set and no sample has come since.

    Returns:
        False where there is nothing to keep yet.

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
            "unaided": live.unaided.values if live.fusion is not None else live.state.values,
            "taught": _packed(sorted(live.taught)),
            "motor_angle": live.sample.motor_angle,
            "joint_angle": live.sample.joint_angle,
        }
        if live.spread is not None:
            arrays |= live.spread.memory()
    buffer = BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    try:
        write_bytes(path, with_checksum(buffer.getvalue()))
    except OSError as error:
        raise StateFileError(f"cannot write the state file {path}: {error.strerror}") from error
    return True


def read_state(live: LiveEstimator, path: Path) -> str:
    """Take up what a file says; the estimator is as it was where it says nothing usable.

    Returns:
        What was taken up, in words; empty where there is no such file.

    Raises:
        StateFileError: the file is not one, or another robot's.
    """
    try:
        if path.stat().st_size > MAXIMUM_BYTES:
            raise StateFileError(f"{path} is too large for a state file")
        content = path.read_bytes()
    except FileNotFoundError:
        return ""
    except OSError as error:
        raise StateFileError(f"cannot read the state file {path}: {error.strerror}") from error
    arrays = _arrays(content, path)
    if arrays.get("robot", np.empty(0)).tobytes() != _digest(live.started).tobytes():
        raise StateFileError(f"{path} is of another robot, or of other parameters")
    words = _take_up_changes(live, arrays, path)
    if "state" not in arrays:
        return f"{words} from {path}; the state itself is unknown"
    if arrays.get("digest", np.empty(0)).tobytes() != _digest(live.model).tobytes():
        said = f"{words} taken up; " if words else ""
        raise StateFileError(f"{said}the state in {path} is of other friction")
    _take_up_state(live, arrays, path)
    return f"goes on from {path}" + (f", with {words}" if words else "")


def _take_up_state(live: LiveEstimator, arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    """State, ensemble, and what other sensors have taught the state.

    Raises:
        StateFileError: what the file holds is unusable; nothing has changed then.
    """
    values, stamp = arrays["state"], arrays.get("stamp")
    unaided = arrays.get("unaided", values)
    for one in (values, unaided):
        if one.shape != (live.model.state_size,) or not np.all(np.isfinite(one)):
            raise StateFileError(f"{path} holds no usable state")
    if stamp is None or stamp.shape != (1,):
        raise StateFileError(f"{path} holds no stamp")
    try:
        taught = [str(name) for name in json.loads(arrays["taught"].tobytes())]
    except (KeyError, TypeError, ValueError) as error:
        raise StateFileError(f"{path} holds no usable list of sensors: {error}") from error
    if live.spread is not None and not live.spread.recall(arrays):
        live.spread.reset()
    state = State(int(stamp[0]), values.astype(np.float64))
    live.resume(state, arrays, unaided.astype(np.float64), taught)


def _take_up_changes(live: LiveEstimator, arrays: Mapping[str, NDArray[Any]], path: Path) -> str:
    """Reference angles and preloads that were set in the earlier run; returns them in words.

    Raises:
        StateFileError: what the file says cannot be; nothing has changed then.
    """
    try:
        changes = json.loads(arrays["changes"].tobytes())
        if not changes:
            return ""
        if not all(CHANGED.fullmatch(name) for name in changes):
            raise ValueError("numbers that no service sets")
        live.change({name: float(value) for name, value in changes.items()})
    except (KeyError, TypeError, ValueError, AttributeError, CdrjError) as error:
        raise StateFileError(f"{path} holds no usable changes: {error}") from error
    return ", ".join(f"{name} = {value:g}" for name, value in live.changes.items())
