"""Tasks that other processes can import: they work, fail, die, or wait to be killed."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from threading import Event

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import BagError


def square(task: float) -> float:
    """Works; a negative number fails as a bag would, 13 with a bug, 99 kills its process, 66 gives
    something else than a number."""
    if task < 0:
        raise BagError(f"{task} is no bag")
    if task == 13:
        raise ValueError("a bug\nof two lines")
    if task == 66:
        return {"no": "number"}  # type: ignore[return-value]
    if task == 99:
        os.kill(os.getpid(), signal.SIGKILL)
    return 0.1 * task * task


def killed_once(task: str) -> str:
    """Note the process in the file ``task``; wait to be killed at the first attempt."""
    path = Path(task)
    first = not path.exists()
    with path.open("a", encoding="utf-8") as file:
        file.write(f"{os.getpid()}\n")
    if first:
        Event().wait()
    return path.name


def noted(task: tuple[str, str]) -> str:
    """Append its name to a file."""
    note, name = task
    with Path(note).open("a", encoding="utf-8") as file:
        file.write(f"{name}\n")
    return name


def sum_with(first: float, table: NDArray[np.float64]) -> float:
    """Works; a negative number fails."""
    if first < 0:
        raise BagError(f"{first} is no number")
    return float(first * table.sum())


def sum_after_death(note: str, table: NDArray[np.float64]) -> float:
    """Kill the process at the first attempt; then the sum of the table."""
    path = Path(note)
    if not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return float(table.sum())
