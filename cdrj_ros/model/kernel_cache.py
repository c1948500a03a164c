"""The cache of compiled kernels on disk; kernels run even if the disk fails.

A kernel is looked up beside its source, where the build leaves it, and then in a folder that this
user can write.  Machine code of another processor or another version of numba is never loaded.
Numba assumes that the folder can be written and that its files are intact.  Here a kernel that
cannot be written to disk is compiled in memory, a damaged one is compiled anew, and each of these
problems is logged once.
"""

from __future__ import annotations

import inspect
import logging
import os
import pickle
from collections.abc import Callable
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final

import numba
from numba.core import caching, codegen, registry
from numba.core.runtime import nrt

from cdrj_ros.foundation.text import printable
from cdrj_ros.model.kernel_parts import compiles_part
from cdrj_ros.model.linked import bring_callees

_LOG: Final = logging.getLogger(__name__)
_caching: Final[Any] = caching  # numba has no types of its own
_codegen: Final[Any] = codegen
_registry: Final[Any] = registry
_nrt: Final[Any] = nrt._nrt  # type: ignore[attr-defined,unused-ignore]
_config: Final[Any] = numba.config
_told: Final[set[str]] = set()


def _say_once(kind: str, text: str, *values: object) -> None:
    """Log a warning unless one of its kind has been logged by this process."""
    if kind not in _told:
        _told.add(kind)
        _LOG.warning(text, *values)


@cache
def _declare_runtime() -> None:
    """Make numba's run-time system known by name to the machine code of kernels from disk.

    ``rtsys.initialize`` also compiles functions for use in compilations, which takes 0.02 s and
    23 MB.  A compilation calls it.
    """
    for name, address in _nrt.c_helpers.items():
        _codegen.ll.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


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


class _StoredLibrary(_codegen.JITCodeLibrary):  # type: ignore[misc]
    """A kernel from disk whose LLVM code is parsed only if another kernel is compiled with it.

    Numba parses it at once, which takes four fifths of the time of loading and 34 MB for a node.
    """

    _unparsed: bytes | None = None

    @classmethod
    def _unserialize(cls, generator: Any, state: tuple[str, str, Any]) -> Any:
        name, kind, data = state
        if kind != "object":  # pragma: no cover - numba stores kernels as objects
            return super()._unserialize(generator, state)
        library = cls(generator, name)
        machine_code, library._unparsed = data
        bring_callees(machine_code)
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        return library

    def _get_module_for_linking(self) -> Any:
        if self._unparsed is not None:
            self._shared_module = _codegen.ll.parse_bitcode(self._unparsed)
            self._unparsed = None
        return super()._get_module_for_linking()

    def get_pointer_to_function(self, name: str) -> Any:
        """Address of a function; numba looks the name up in the parsed code."""
        if self._unparsed is None:
            return super().get_pointer_to_function(name)
        return self._codegen._engine.get_function_address(name)


class _Implementation(_caching.FunctionCache._impl_class):  # type: ignore[misc]
    _locator_classes = [  # noqa: RUF012 - as numba declares it
        *_caching.FunctionCache._impl_class._locator_classes,
        _InstalledLocator,
    ]

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """A kernel of the bytes on disk, as a ``_StoredLibrary``."""
        generator = target_context.codegen()
        usual = generator._library_class
        generator._library_class = _StoredLibrary
        try:
            return super().rebuild(target_context, payload)
        finally:
            generator._library_class = usual


class KernelCache(_caching.FunctionCache):  # type: ignore[misc]
    """Numba's cache of one function; where reading or writing fails, the function is compiled."""

    _impl_class = _Implementation

    def __init__(self, function: Callable[..., Any], stamp: str) -> None:
        """Find the folders of the kernel.

        Args:
            function: the function to be compiled.
            stamp: digest of the sources that it is compiled from.

        Raises:
            RuntimeError, OSError: no folder can be used.
        """
        super().__init__(function)
        self._cache_file._source_stamp = stamp
        self._built: Any = None
        """Files beside the source if kernels are written to another folder; otherwise None."""
        beside = str(Path(inspect.getfile(function)).parent / "__pycache__")
        # with NUMBA_CACHE_DIR set, no other folder is searched
        if beside != self.cache_path and not _config.CACHE_DIR:
            self._built = _caching.IndexDataCacheFile(beside, self._impl.filename_base, stamp)

    def _index_key(self, sig: Any, generator: Any) -> tuple[Any, ...]:
        """Key of a kernel: types and processor; the stamp stands for all sources.

        Numba's key has a hash of the byte code too, which is another without docstrings (``-OO``).
        """
        return sig, generator.magic_tuple()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the kernel from disk; None if it is missing or damaged and has to be compiled.

        Numba's own method also loads what a compilation needs, which takes 0.2 s and 43 MB.
        Machine code from disk needs only the names of the run-time system.
        """
        _declare_runtime()
        if self._built is not None:
            found = self._load_from(self._built, sig, target_context)[0]
            if found is not None:
                return found
        if not self._enabled:
            return None
        found, damaged = self._load_from(self._cache_file, sig, target_context)
        if damaged:
            try:
                self.flush()
            except OSError:
                self.disable()
        elif found is None:
            self._say_why_not(sig, target_context.codegen().magic_tuple())
        return found

    def _load_from(self, files: Any, sig: Any, target_context: Any) -> tuple[Any, bool]:
        """The kernel in one folder, or None, and whether its files are damaged."""
        try:
            data = files.load(self._index_key(sig, target_context.codegen()))
            return (None if data is None else self._impl.rebuild(target_context, data)), False
        except Exception as error:  # noqa: BLE001 - unpickling damaged bytes raises anything
            _say_once(
                "damaged",
                "a compiled kernel in %s is damaged (%s: %s); it is discarded and compiled anew",
                files._cache_path,
                type(error).__name__,
                error,
            )
            return None, True

    def _say_why_not(self, sig: Any, processor: Any) -> None:
        """Log why the kernels found on disk cannot be used."""
        files = self._built or self._cache_file
        version = _version_of(files)
        processors = {key[1] for key in _index(files) if key[0] == sig}
        if version not in (None, numba.__version__):
            _say_once(
                "other version",
                "the compiled kernels in %s are of numba %s, this is %s: they are compiled anew",
                files._cache_path,
                printable(str(version)),
                numba.__version__,
            )
        elif processors and processor not in processors:
            _say_once(
                "other processor",
                "the compiled kernels in %s are for another processor: they are compiled anew",
                files._cache_path,
            )

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
        """Whether the kernel, compiled from these sources for this processor, is on disk."""
        processor = _registry.cpu_target.target_context.codegen().magic_tuple()
        places = (self._cache_file,) if self._built is None else (self._built, self._cache_file)
        return any(key[1] == processor for files in places for key in _index(files))


def _index(files: Any) -> dict[Any, Any]:
    """Signatures and processors of the kernels in a folder; empty if it cannot be read."""
    try:
        found: dict[Any, Any] = files._load_index()
    except Exception:  # noqa: BLE001 - as in _load_from
        return {}
    return found


def _version_of(files: Any) -> object:
    """Version of numba that wrote a folder's index; None if there is none."""
    try:
        with open(files._index_path, "rb") as file:  # noqa: PTH123 - numba's paths are texts
            return pickle.load(file)  # noqa: S301 - as numba does
    except Exception:  # noqa: BLE001 - as in _load_from
        return None


class LaterCache(_caching.NullCache):  # type: ignore[misc]
    """The cache of a kernel, whose folders are searched when the kernel is first needed.

    Most kernels are parts of others and never needed.  Searching tries whether a folder can be
    written, which took a tenth of the time of a start.
    """

    def __init__(self, function: Callable[..., Any], stamp: str) -> None:
        self._function, self._stamp = function, stamp

    @cached_property
    def _found(self) -> Any:
        try:
            return KernelCache(self._function, self._stamp)
        except (RuntimeError, OSError) as error:
            _say_once(
                "no place",
                "there is no place for compiled kernels (%s): they are compiled at every start, "
                "which takes about a minute; NUMBA_CACHE_DIR names a folder that can be written",
                error,
            )
            return _caching.NullCache()

    @property
    def cache_path(self) -> Any:
        """Folder into which the kernel is written; None if there is none."""
        return self._found.cache_path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """As ``KernelCache``'s; parts of a kernel are not loaded, so that it is always the same."""
        return None if compiles_part() else self._found.load_overload(sig, target_context)

    def save_overload(self, sig: Any, cres: Any) -> None:
        """As ``KernelCache``'s; parts of a kernel are not stored."""
        if not compiles_part():
            self._found.save_overload(sig, cres)

    def is_filled(self) -> bool:
        """Whether the kernel, compiled from these sources for this processor, is on disk."""
        return isinstance(self._found, KernelCache) and self._found.is_filled()
