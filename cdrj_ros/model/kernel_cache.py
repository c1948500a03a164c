"""The cache of compiled kernels on disk; a failing disk does not stop a kernel.

Numba assumes that a folder can be written and that the files in it are intact.  Here a kernel that
cannot be written to disk is compiled in memory, a damaged one is compiled anew, and the log says so
once.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from typing import Any, Final

from numba.core import caching

_LOG: Final = logging.getLogger(__name__)
_caching: Final[Any] = caching  # numba has no types of its own
_told: Final[set[str]] = set()


def _say_once(kind: str, text: str, *values: object) -> None:
    """Log a warning unless one of its kind has been logged by this process."""
    if kind not in _told:
        _told.add(kind)
        _LOG.warning(text, *values)


def _in_tree() -> Any:
    """Numba's locator of the folder ``__pycache__`` beside a source; its name varies."""
    for locator in _caching.FunctionCache._impl_class._locator_classes:
        if locator.__name__.lstrip("_") == "InTreeCacheLocator":
            return locator
    raise RuntimeError("numba has no in-tree cache")  # pragma: no cover


class _InstalledLocator(_in_tree()):  # type: ignore[misc]
    """Locator of kernels beside a source, in a folder that this user may read but not write."""

    def ensure_cache_path(self) -> None:
        """Accept a folder that exists."""
        if not os.path.isdir(self.get_cache_path()):  # noqa: PTH112 - numba's paths are texts
            raise FileNotFoundError(self.get_cache_path())


class _Implementation(_caching.FunctionCache._impl_class):  # type: ignore[misc]
    _locator_classes = [  # noqa: RUF012 - as numba declares it
        *_caching.FunctionCache._impl_class._locator_classes,
        _InstalledLocator,
    ]


class KernelCache(_caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function; where reading or writing fails, the function is compiled."""

    _impl_class = _Implementation

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the kernel from disk; None, so that it is compiled, if missing or damaged."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 - unpickling damaged bytes raises anything
            _say_once(
                "damaged",
                "a compiled kernel in %s is damaged (%s: %s); it is discarded and compiled anew",
                self.cache_path,
                type(error).__name__,
                error,
            )
        try:
            self.flush()
        except OSError:
            self.disable()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the kernel to disk where possible; log a warning otherwise."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self.disable()
            _say_once(
                "unwritten",
                "compiled kernels cannot be kept in %s (%s): they are compiled at every start; "
                "NUMBA_CACHE_DIR names another folder",
                self.cache_path,
                error,
            )

    def is_filled(self) -> bool:
        """Whether a kernel compiled from the present sources is on disk; it is not loaded."""
        try:
            return bool(self._cache_file._load_index())
        except Exception:  # noqa: BLE001 - as in load_overload
            return False


def kernel_cache(function: Callable[..., Any], stamp: str) -> KernelCache | None:
    """The cache of one kernel, valid for sources with this stamp; None without a usable folder."""
    try:
        cache = KernelCache(function)
    except (RuntimeError, OSError) as error:
        _say_once(
            "no place",
            "there is no place for compiled kernels (%s): they are compiled at every start, which "
            "takes about a minute; NUMBA_CACHE_DIR names a folder that can be written",
            error,
        )
        return None
    cache._cache_file._source_stamp = stamp
    return cache
