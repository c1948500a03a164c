"""Notice before the numerical kernels are compiled, which can take up to a minute."""

from __future__ import annotations

import sys
from typing import Final

from cdrj_ros.model.compiled import kernels_are_compiled
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.shape import shape

COMPILING: Final = "compiling the numerical kernels, up to a minute; kept for the next start ..."


def announce_compilation() -> None:
    """Print a notice on standard error if the kernels are about to be compiled."""
    if not kernels_are_compiled(shape, advance):
        print(COMPILING, file=sys.stderr, flush=True)
