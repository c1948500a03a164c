"""Entry points of the nodes, which handle Ctrl-C before they import ROS."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NoReturn

from cdrj_ros.foundation.interruption import INTERRUPTED, run_interruptibly


def _interrupted() -> int:
    """Exit code after Ctrl-C of a node that takes ``--supervised``, also while it is imported."""
    return 0 if "--supervised" in sys.argv[1:] else INTERRUPTED


def estimator() -> NoReturn:
    """Run the estimator node."""

    def load() -> Callable[[], int]:
        from cdrj_ros.nodes.estimator_command import main

        return main

    run_interruptibly("estimator", load, _interrupted())


def replay() -> NoReturn:
    """Run the replay node."""

    def load() -> Callable[[], int]:
        from cdrj_ros.nodes.replay import main

        return main

    run_interruptibly("replay", load)


def watch() -> NoReturn:
    """Run the watch node, which shows the live table."""

    def load() -> Callable[[], int]:
        from cdrj_ros.nodes.watch import main

        return main

    run_interruptibly("watch", load)


def rig() -> NoReturn:
    """Run the rig node."""

    def load() -> Callable[[], int]:
        from cdrj_ros.nodes.rig import main

        return main

    run_interruptibly("rig", load, _interrupted())


def markers() -> NoReturn:
    """Run the markers node."""

    def load() -> Callable[[], int]:
        from cdrj_ros.nodes.markers import main

        return main

    run_interruptibly("markers", load, _interrupted())


def view() -> NoReturn:
    """Run the view node, or show a bag."""

    def load() -> Callable[[], int]:
        from cdrj_ros.nodes.view import main

        return main

    run_interruptibly("view", load)
