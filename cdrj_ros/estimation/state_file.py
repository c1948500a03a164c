"""What an estimator knows, in a file, so that a restart goes on where the last run ended."""

from __future__ import annotations

import hashlib
import os
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np

from cdrj_ros.estimation.estimator import State
from cdrj_ros.estimation.live import LiveEstimator
from cdrj_ros.model.errors import CdrjError

MAXIMUM_BYTES: Final = 50_000_000
"""A state file is small; more is not one."""


class StateFileError(CdrjError):
    """A state file that cannot be used; the estimator starts without it."""


def _digest(live: LiveEstimator) -> bytes:
    """Of everything that a state only makes sense with."""
    model = live.model
    digest = hashlib.sha256(b"cdrj_ros state 1")
    digest.update(model.plan.tobytes())
    digest.update(model.numbers.tobytes())
    return digest.digest()


def write_state(live: LiveEstimator, path: Path) -> bool:
    """Write what an estimator knows, all or nothing: a crash leaves the old file or the new one.

    Returns:
        False where there is nothing to keep yet.

    Raises:
        StateFileError: the file cannot be written.
    """
    if live.sample is None:
        return False
    arrays = {
        "digest": np.frombuffer(_digest(live), dtype=np.uint8),
        "stamp": np.array([live.state.stamp_ns]),
        "state": live.state.values,
        "motor_angle": live.sample.motor_angle,
        "joint_angle": live.sample.joint_angle,
    }
    if live.spread is not None:
        arrays |= live.spread.memory()
    buffer = BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(buffer.getvalue())
                file.flush()
                os.fsync(file.fileno())
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
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
        with np.load(BytesIO(path.read_bytes()), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        return ""
    except (OSError, ValueError, EOFError, KeyError) as error:
        raise StateFileError(f"{path} is not a state file: {error}") from error
    except Exception as error:  # a damaged archive raises what it likes
        if type(error).__module__ not in ("zipfile", "zlib"):
            raise
        raise StateFileError(f"{path} is not a state file: {error}") from error
    if arrays.get("digest", np.empty(0)).tobytes() != _digest(live):
        raise StateFileError(f"{path} is of another robot, or of other parameters")
    values, stamp = arrays.get("state"), arrays.get("stamp")
    if (
        values is None
        or values.shape != (live.model.state_size,)
        or not np.all(np.isfinite(values))
    ):
        raise StateFileError(f"{path} holds no usable state")
    if stamp is None or stamp.shape != (1,):
        raise StateFileError(f"{path} holds no stamp")
    if live.spread is not None and not live.spread.recall(arrays):
        live.spread.reset()
    live.resume(State(int(stamp[0]), values.astype(np.float64)), arrays)
    return f"goes on from {path}"
