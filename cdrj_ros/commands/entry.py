"""Entry points of the commands, which handle Ctrl-C before slow modules are imported."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from cdrj_ros.foundation.interruption import run_interruptibly


def check_robot() -> NoReturn:
    """Run ``check_robot``."""

    def load() -> Callable[[], int]:
        from cdrj_ros.commands.check_robot import main

        return main

    run_interruptibly("check_robot", load)


def commission() -> NoReturn:
    """Run ``commission``."""

    def load() -> Callable[[], int]:
        from cdrj_ros.commands.commission import main

        return main

    run_interruptibly("commission", load)


def identify() -> NoReturn:
    """Run ``identify``."""

    def load() -> Callable[[], int]:
        from cdrj_ros.commands.identify import main

        return main

    run_interruptibly("identify", load)


def import_robot() -> NoReturn:
    """Run ``import_robot``."""

    def load() -> Callable[[], int]:
        from cdrj_ros.commands.import_robot import main

        return main

    run_interruptibly("import_robot", load)


def simulate() -> NoReturn:
    """Run ``simulate``."""

    def load() -> Callable[[], int]:
        from cdrj_ros.commands.simulate import main

        return main

    run_interruptibly("simulate", load)


def validate() -> NoReturn:
    """Run ``validate``."""

    def load() -> Callable[[], int]:
        from cdrj_ros.commands.validate import main

        return main

    run_interruptibly("validate", load)


def view() -> NoReturn:
    """Run ``view`` for a bag."""

    def load() -> Callable[[], int]:
        from cdrj_ros.commands.view import main

        return main

    run_interruptibly("view", load)
