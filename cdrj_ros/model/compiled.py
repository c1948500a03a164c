"""Ahead-of-use compilation of the numerical kernels, cached on disk.

Numba invalidates a cached function when its own file changes, but not when the file of a function
that it calls does: after an upgrade, the new solver could run the old friction law.  Every kernel
is therefore stamped with a digest of all sources that it may be made of: those of the model, and
``kernel_sources`` of its own file.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from cdrj_ros.model.kernel_cache import LaterCache
from cdrj_ros.model.kernel_parts import compile_as_part_or_whole

F = TypeVar("F", bound=Callable[..., Any])
_Number = TypeVar("_Number", np.float64, np.int64, np.bool_)

_FOLDER = Path(__file__).parent


def _add(digest: Any, paths: Iterable[Path]) -> Any:
    """The digest with the names and contents of files, in the order of their paths."""
    for path in sorted(paths):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest


@lru_cache
def _digest_of_model() -> Any:
    """Digest of every source file of the model, read once, which takes 2 ms."""
    return _add(hashlib.sha256(), _FOLDER.glob("*.py"))


def source_digest(*more: Path) -> str:
    """Digest of every source file of the model and of ``more``; it stamps the kernel cache."""
    others = {path for path in more if path.parent != _FOLDER}
    return str(_add(_digest_of_model().copy(), others).hexdigest())


def kernel_sources(file: Path) -> set[Path]:
    """A file and all that it imports from its own folder, directly or not.

    Kernels outside of the model's folder are made of these sources and of the model's.
    """
    own = re.compile(rf"^from cdrj_ros\.{file.parent.name}\.(\w+) import", re.MULTILINE)
    found, left = set(), {file}
    while left:
        one = left.pop()
        found.add(one)
        names = own.findall(one.read_text(encoding="utf-8"))
        left |= {file.with_name(f"{name}.py") for name in names} - found
    return found


@lru_cache
def _stamp(file: Path | None) -> str:
    """Stamp of the kernels in a file outside of the model's folder, or of all kernels in it."""
    return source_digest() if file is None else source_digest(*kernel_sources(file))


def compiled(function: F) -> F:
    """Compile ``function`` to machine code at first use and keep the result on disk.

    IEEE arithmetic is kept (no ``fastmath``): the node and the offline tools must agree bit for
    bit.  A division by zero yields inf or NaN, as in NumPy.  Kernels release the interpreter's
    lock, so that several threads can run them at once.

    Args:
        function: takes scalars and arrays; written in the subset of Python that numba compiles.
    """
    return _compile(function, _nrt=True)


def lean(function: F) -> F:
    """As ``compiled``, for a kernel that allocates nothing; numba rejects a kernel that does.

    Arrays are passed without reference counts, whose updates took a fifth of the time of a sample.
    The caller keeps the arrays alive.
    """
    return _compile(function, _nrt=False)


def inlined(function: F) -> F:
    """As ``lean``, inlined into each of its callers."""
    return _compile(function, _nrt=False, forceinline=True)


def callee(function: F) -> F:
    """As ``lean``, for a kernel that only kernels call: a call from Python raises TypeError.

    Its entry from Python would take as long to compile as many a kernel itself.
    """
    return _for_kernels(_compile(function, _nrt=False, no_cpython_wrapper=True))


def stage(function: F) -> F:
    """As ``callee``, for a part of a larger kernel; it is inlined into each of its callers."""
    return _for_kernels(_compile(function, _nrt=False, forceinline=True, no_cpython_wrapper=True))


def _for_kernels(kernel: F) -> F:
    """Make calls from Python an error; numba would jump to an entry that is not there."""

    def refuse(*_: object, **__: object) -> None:
        raise TypeError(f"only kernels can call {kernel.__name__}")

    if hasattr(kernel, "overloads"):
        dispatcher: Any = kernel
        dispatcher._insert = lambda *_, **__: None  # the entry that calls from Python look up
        dispatcher._compile_for_args = refuse
    return kernel


def usable_in_kernels(function: F) -> F:
    """Let kernels inline ``function``; Python calls it uncompiled."""
    usable: F = register_jitable(
        forceinline=True, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)
    return usable


def _compile(function: F, forceinline: bool = False, **options: bool) -> F:
    """The kernel of a function.

    ``forceinline`` is always set: what is not set, numba takes over from the caller.  Everything
    that a stage called was inlined, so that the balance of a cable stood in the step eight times.
    """
    if getattr(numba.config, "DISABLE_JIT", 0):  # NUMBA_DISABLE_JIT=1, for a debugger
        return function
    njit: Any = numba.njit
    options |= {"nogil": True, "no_cfunc_wrapper": True, "forceinline": forceinline}
    dispatcher = njit(error_model="numpy", **options)(function)
    # computed now and not when it is used: the sources may be replaced while the process runs
    file = Path(function.__code__.co_filename)
    stamp = _stamp(None if file.parent == _FOLDER else file)
    dispatcher._cache = LaterCache(function, stamp)
    # kernels need no extension of numba, for which it would search all installed packages: 20 ms
    dispatcher._compilation_chain_init_hook = lambda: None
    compile_as_part_or_whole(dispatcher)
    return dispatcher


def ordinary(array: NDArray[_Number]) -> NDArray[_Number]:
    """The array, or a copy of it if it is not contiguous or not writable.

    Layout and writability are parts of a type, and the dispatcher compiles a kernel again for each.
    """
    plain = np.ascontiguousarray(array)
    return plain if plain.flags.writeable else plain.copy()


def direct(kernel: F, *arguments: Any) -> F:
    """Entry point of a kernel, without numba's dispatcher, which is slower than some kernels.

    The dispatcher checks the types of all arguments at every call; the entry point checks none.
    A call with other types than those of ``arguments`` reads invalid memory.  Use the entry point
    only with arrays that the caller has created itself and keeps alive.
    """
    if not hasattr(kernel, "overloads"):  # compilation is switched off
        return kernel
    typeof: Any = numba.typeof
    dispatcher: Any = kernel
    types = tuple(typeof(argument) for argument in arguments)
    dispatcher.compile(types)
    entry: F = dispatcher.overloads[types].entry_point
    return entry


def interpret(kernel: Callable[..., Any]) -> None:
    """Until ``compile_at_calls``, let calls from Python run the source of a kernel.

    Without effect on a kernel that has been compiled or loaded.
    """
    dispatcher: Any = kernel
    if hasattr(kernel, "overloads"):
        dispatcher._compile_for_args = lambda *_, **__: dispatcher.py_func


def compile_at_calls(kernel: Callable[..., Any]) -> None:
    """Undo ``interpret``."""
    vars(kernel).pop("_compile_for_args", None)


def kernels_are_compiled(*kernels: Callable[..., Any]) -> bool:
    """Whether the machine code of kernels is on disk, so that their first call does not compile.

    The check loads no kernel.  Name the outermost kernels; the kernels that they call are compiled
    with them.  If compilation is switched off, kernels are plain functions and count as compiled.
    """
    return all(kernel._cache.is_filled() for kernel in kernels if hasattr(kernel, "_cache"))


def kernels_can_be_kept(*kernels: Callable[..., Any]) -> bool:
    """Whether there is a folder for the machine code of kernels that have to be compiled."""
    return all(
        kernel._cache.cache_path is not None for kernel in kernels if hasattr(kernel, "_cache")
    )
