"""Functions that are compiled only to become a part of a kernel.

Numba optimises every function that a kernel calls, and again with each of its callers, and emits
machine code for it that is never run.  Here a part stays LLVM code, hardly optimised, until the
kernel that it is linked into is whole.  All kernels compile in two thirds of the time, the step in
half.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from numba.core import codegen, compiler_lock, registry, sigutils

from cdrj_ros.foundation.interruption import holding

_codegen: Final[Any] = codegen  # numba has no types of its own
_lock: Final[Any] = compiler_lock.global_compiler_lock  # type: ignore[attr-defined,unused-ignore]
_registry: Final[Any] = registry
_sigutils: Final[Any] = sigutils


class _Now:
    """What numba compiles now; a state of the process, as numba's own, changed under its lock."""

    whole: str | None = None
    """Name of the kernel that is compiled as a whole."""
    part = False
    """Whether a part of it is being compiled."""


class _NowhereLoaded:
    """A code generator for which no environment is set; machine code would hold its address."""

    def __init__(self, generator: Any) -> None:
        self._generator = generator

    def __getattr__(self, name: str) -> Any:
        return getattr(self._generator, name)

    def set_env(self, *_: object) -> None:
        """Do nothing: there is no machine code."""


class _Part(_codegen.JITCodeLibrary):  # type: ignore[misc]
    """LLVM code without optimisation across functions and without machine code."""

    @property
    def codegen(self) -> Any:
        return _NowhereLoaded(self._codegen)

    def _optimize_functions(self, module: Any) -> None:
        """Omit numba's passes over every function, also over those that are only declared.

        They took 6 % of the time of all compilations; the kernels are as fast without.
        """
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Simplify it as numba does first; the kernel would be 3 % slower without."""
        options = {"loop_vectorize": False, "slp_vectorize": False, "opt": 0, "cost": "cheap"}
        passes = self._codegen._module_pass_manager(**options)
        if isinstance(passes, tuple):
            passes[0].run(self._final_module, passes[1])
        else:  # numba before 0.62
            passes.run(self._final_module)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


def _library(generator: Any, name: str) -> Any:
    """Library for a function: that of the whole kernel has machine code."""
    kind = _codegen.JITCodeLibrary if name == _Now.whole else _Part
    return kind(generator, name)


def compiles_part() -> bool:
    """Whether what is compiled now becomes a part of a kernel."""
    return _Now.part


@contextmanager
def apart(name: str | None = None) -> Iterator[None]:
    """Compile the kernel of a name, or any, as a whole, whatever is being compiled."""
    generator = _registry.cpu_target.target_context.codegen()
    with _lock:
        before = _Now.whole, _Now.part, generator._library_class
        _Now.whole, _Now.part, generator._library_class = name, False, _library
        try:
            yield
        finally:
            _Now.whole, _Now.part, generator._library_class = before


@contextmanager
def _as_part() -> Iterator[None]:
    before, _Now.part = _Now.part, True
    try:
        yield
    finally:
        _Now.part = before


def compile_as_part_or_whole(dispatcher: Any) -> None:
    """Let a kernel be compiled as a part while another kernel is, and otherwise as a whole.

    Ctrl-C does not interrupt a compilation, because an exception in it would end LLVM's process.
    """
    compile_: Callable[[Any], Any] = dispatcher.compile
    insert: Callable[..., None] = dispatcher._insert
    name = dispatcher.py_func.__qualname__

    def compile_here(signature: Any) -> Any:
        with holding(), _lock:
            if _Now.whole is not None:
                with _as_part():
                    return compile_(signature)
            _forget_part(dispatcher, signature)
            with apart(name):
                return compile_(signature)

    def insert_here(*entry: Any, **options: Any) -> None:
        if not _Now.part:
            insert(*entry, **options)

    dispatcher.compile, dispatcher._insert = compile_here, insert_here


def _forget_part(dispatcher: Any, signature: Any) -> None:
    """Forget that a kernel has been compiled as a part, which cannot be called."""
    arguments = tuple(_sigutils.normalize_signature(signature)[0])
    found = dispatcher.overloads.get(arguments)
    if found is not None and isinstance(found.library, _Part):
        del dispatcher.overloads[arguments]
