"""Tasks that other processes can import: they work, fail, die, or wait to be killed."""

import os
import signal
from pathlib import Path
from threading import Event

from cdrj_ros.foundation.errors import BagError


def square(task):
    """Works; a negative number fails as a bag would, 13 with a bug, 99 kills its process."""
    if task < 0:
        raise BagError(f"{task} is no bag")
    if task == 13:
        raise ValueError("a bug\nof two lines")
    if task == 99:
        os.kill(os.getpid(), signal.SIGKILL)
    return 0.1 * task * task


def killed_once(task):
    """Note the process in the file ``task``; wait to be killed at the first attempt."""
    path = Path(task)
    first = not path.exists()
    with path.open("a", encoding="utf-8") as file:
        file.write(f"{os.getpid()}\n")
    if first:
        Event().wait()
    return path.name


def noted(task):
    """Append its name to a file."""
    note, name = task
    with Path(note).open("a", encoding="utf-8") as file:
        file.write(f"{name}\n")
    return name
