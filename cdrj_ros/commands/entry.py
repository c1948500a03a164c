"""Entry points of the commands, which handle Ctrl-C before slow modules are imported.

Exit codes and error lines are those of all commands.  The module imports little.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final, NoReturn

from cdrj_ros.foundation.errors import CdrjError, reason_of
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


def run_command(
    name: str, body: Callable[[Sequence[str]], int], argv: Sequence[str] | None = None
) -> int:
    """Run a command's body; errors of this package become one line and exit code 2.

    The exit code and the files that the body writes do not depend on standard output, which may be
    closed or full.
    """
    with lasting_output(name):
        try:
            return body(sys.argv[1:] if argv is None else argv)
        except (CdrjError, OSError) as error:
            words = reason_of(error)
        except MemoryError as error:
            words = f"not enough memory: {error}" if str(error) else "not enough memory"
        print(printable(f"{name}: {words}"), file=sys.stderr)
        return BAD_INPUT


_PACKAGE: Final = "cdrj_ros.commands"
check_robot = partial(run_module, "check_robot", f"{_PACKAGE}.check_robot")
commission = partial(run_module, "commission", f"{_PACKAGE}.commission")
identify = partial(run_module, "identify", f"{_PACKAGE}.identify")
import_robot = partial(run_module, "import_robot", f"{_PACKAGE}.import_robot")
simulate = partial(run_module, "simulate", f"{_PACKAGE}.simulate")
validate = partial(run_module, "validate", f"{_PACKAGE}.validate")
view = partial(run_module, "view", f"{_PACKAGE}.view")
"""Each runs the command of its name; ``view`` shows a bag."""
