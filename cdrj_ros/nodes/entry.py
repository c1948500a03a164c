"""Entry points of the nodes, which handle Ctrl-C before they import ROS."""

from __future__ import annotations

import sys
from typing import NoReturn

from cdrj_ros.foundation.interruption import INTERRUPTED, run_module


def _run(name: str) -> NoReturn:
    """Import the node's module and run its ``main``.

    A node that takes ``--supervised`` ends with code 0 after Ctrl-C, also while it is imported.
    """
    supervised = name in ("estimator", "rig", "markers") and "--supervised" in sys.argv[1:]
    run_module(
        name,
        f"cdrj_ros.nodes.{name}",
        0 if supervised else INTERRUPTED,
    )


def estimator() -> NoReturn:
    """Run the estimator node."""
    _run("estimator")


def replay() -> NoReturn:
    """Run the replay node."""
    _run("replay")


def watch() -> NoReturn:
    """Run the watch node, which shows the live table."""
    _run("watch")


def rig() -> NoReturn:
    """Run the rig node."""
    _run("rig")


def markers() -> NoReturn:
    """Run the markers node."""
    _run("markers")


def view() -> NoReturn:
    """Run the view node, or show a bag."""
    _run("view")
