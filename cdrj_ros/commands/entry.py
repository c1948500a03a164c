"""Entry points of the commands, which handle Ctrl-C before slow modules are imported."""

from __future__ import annotations

from typing import NoReturn

from cdrj_ros.foundation.interruption import run_module


def check_robot() -> NoReturn:
    """Run ``check_robot``."""
    run_module("check_robot", "cdrj_ros.commands.check_robot")


def commission() -> NoReturn:
    """Run ``commission``."""
    run_module("commission", "cdrj_ros.commands.commission")


def identify() -> NoReturn:
    """Run ``identify``."""
    run_module("identify", "cdrj_ros.commands.identify")


def import_robot() -> NoReturn:
    """Run ``import_robot``."""
    run_module("import_robot", "cdrj_ros.commands.import_robot")


def simulate() -> NoReturn:
    """Run ``simulate``."""
    run_module("simulate", "cdrj_ros.commands.simulate")


def validate() -> NoReturn:
    """Run ``validate``."""
    run_module("validate", "cdrj_ros.commands.validate")


def view() -> NoReturn:
    """Run ``view`` for a bag."""
    run_module("view", "cdrj_ros.commands.view")
