"""A first log line without a search for its caller in every imported module.

rclpy asks ``inspect`` from which line it was called.  For the first one, ``inspect`` resolves the
paths of all modules, of which the estimator imports nine hundred: 45 ms of its start.
"""

from __future__ import annotations

import inspect
import sys
from typing import Final

LOGGING: Final = ("rclpy.", "cdrj_ros.nodes.")
"""What the names of modules that write to the log, or lie between, begin with."""


def introduce_log_callers() -> None:
    """Tell ``inspect`` which files the modules that write to the log come from."""
    for name, module in tuple(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and name.startswith(LOGGING):
            inspect.modulesbyfile.setdefault(file, name)
