"""Calls of a large kernel from other kernels without a copy of its machine code in each of them.

Numba compiles a callee again into every caller.  For the step of a whole robot this took 20 s and
2 MB for each of nine kernels.  Here the caller has the callee's name only, which is resolved when
the caller is loaded, as by a dynamic linker.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

from numba.core import cgutils, codegen, sigutils
from numba.extending import intrinsic

from cdrj_ros.model.kernel_parts import apart

F = TypeVar("F", bound=Callable[..., Any])

_cgutils: Final[Any] = cgutils
_codegen: Final[Any] = codegen
_intrinsic: Final[Any] = intrinsic
_sigutils: Final[Any] = sigutils

_bring: Final[dict[str, Callable[[], None]]] = {}
"""For every name: compile or load the callee, and make its address known."""

_NOWHERE: Final = 1
"""Address of callees that do not exist."""

_without_callees = False


def compile_without_callees() -> None:
    """From now on, do not compile callees with their callers, which then must not be run.

    For a process that only compiles, while others compile the callees.
    """
    global _without_callees  # noqa: PLW0603 - a state of the process, as numba's own
    _without_callees = True


def bring_callees(machine_code: bytes) -> None:
    """Resolve the names in the machine code of a kernel before it is loaded."""
    for name, bring in _bring.items():
        if name.encode() in machine_code:
            bring()


def linked(kernel: F, signature: str) -> F:
    """A function for use in kernels that calls ``kernel``.

    Args:
        kernel: from ``compiled`` or ``lean``.
        signature: its six or seven types, as numba writes them.
    """
    if not hasattr(kernel, "overloads"):  # compilation is switched off
        return kernel
    dispatcher: Any = kernel
    name = f"{dispatcher.__module__}.{dispatcher.__name__}"
    arguments, result = _sigutils.normalize_signature(signature)
    found: list[int] = []

    def bring() -> None:
        if _without_callees:
            _codegen.ll.add_symbol(name, _NOWHERE)
        elif not found:
            with apart():
                dispatcher.compile(arguments)
            overload = dispatcher.overloads[arguments]
            found.append(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))
            _codegen.ll.add_symbol(name, found[0])

    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        kind = context.call_conv.get_function_type(result, arguments)
        function = _cgutils.get_or_insert_function(builder.module, kind, name)
        status, value = context.call_conv.call_function(
            builder, function, result, arguments, values
        )
        with _cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return value

    def call(_: Any, _a: Any, _b: Any, _c: Any, _d: Any, _e: Any, _f: Any) -> Any:
        bring()
        return result(*arguments), generate

    def call_with_seven(_: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, _g: Any) -> Any:
        return call(_, a, b, c, d, e, f)

    _bring[name] = bring
    function: F = _intrinsic(call if len(arguments) == 6 else call_with_seven)
    return function
