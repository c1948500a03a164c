"""Entry points of the commands, which handle Ctrl-C before slow modules are imported.

Exit codes and error lines are those of all commands.  The module imports little.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any, Final, NoReturn

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.interruption import run_module
from cdrj_ros.foundation.output import lasting_output, printable

DONE: Final = 0
OUTSIDE_LIMITS: Final = 1
BAD_INPUT: Final = 2


class CommandParser(argparse.ArgumentParser):
    """A parser that escapes control characters in its errors, since paths may contain them."""

    def error(self, message: str) -> NoReturn:
        """Print usage and the message, then exit with code 2."""
        super().error(printable(message))

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; if the shell asks for completions, answer and exit."""
        if "_ARGCOMPLETE" in os.environ:
            from argcomplete import autocomplete

            autocomplete(self)
        return super().parse_args(args, namespace)


def run_command(name: str, body: Callable[[Sequence[str]], int], argv: Sequence[str] | None) -> int:
    """Run a command's body; errors of this package become one line and exit code 2.

    The exit code and the files that the body writes do not depend on standard output, which may be
    closed or full.
    """
    with lasting_output(name):
        try:
            return body(sys.argv[1:] if argv is None else argv)
        except CdrjError as error:
            words = str(error)
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            words = f"{where}{error.strerror or error}"
        except MemoryError as error:
            words = f"not enough memory: {error}" if str(error) else "not enough memory"
        print(printable(f"{name}: {words}"), file=sys.stderr)
        return BAD_INPUT


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
