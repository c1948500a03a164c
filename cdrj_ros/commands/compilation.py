"""A line before the numerical kernels are compiled, which can take up to a minute."""

from __future__ import annotations

import sys
from typing import Any, Final

from cdrj_ros.model.mechanism import advance

COMPILING: Final = "compiling the numerical kernels, up to a minute; kept for the next start ..."


def kernels_are_compiled(kernel: Any = advance) -> bool:
    """Whether the machine code of a kernel, of the present sources, is kept on disk."""
    cache = getattr(kernel, "_cache", None)
    if cache is None:  # compilation is switched off
        return True
    try:
        return bool(cache._cache_file._load_index())
    except Exception:  # noqa: BLE001 a damaged file is compiled anew, whatever is wrong with it
        return False


def announce_compilation() -> None:
    """Print on standard error that the kernels are going to be compiled, if they are."""
    if not kernels_are_compiled():
        print(COMPILING, file=sys.stderr, flush=True)
