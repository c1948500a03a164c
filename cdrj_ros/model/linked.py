"""Calls of a large kernel from other kernels without a copy of its machine code in each of them.

Numba compiles a callee again into every caller.  For the step of a whole robot this took 20 s and
2 MB for each of nine kernels.  Here the caller has the callee's name only, which is resolved when
the caller is loaded, as by a dynamic linker, or with the first call (lazy binding), so that a
callee that is never called is neither compiled nor loaded.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import addressof, c_size_t
from typing import Any, Final, NamedTuple, TypeVar

from numba.core import cgutils, codegen, sigutils, types
from numba.extending import intrinsic

from cdrj_ros.model.kernel_parts import apart

F = TypeVar("F", bound=Callable[..., Any])

_cgutils: Final[Any] = cgutils
_codegen: Final[Any] = codegen
_intrinsic: Final[Any] = intrinsic
_sigutils: Final[Any] = sigutils
_types: Final[Any] = types

_resolve: Final[dict[str, Callable[[], None]]] = {}
"""For every name of a callee: make the addresses known that its callers need."""

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
    for name, resolve in _resolve.items():
        if name.encode() in machine_code:
            resolve()


def linked(kernel: F, signature: Any) -> F:
    """A function for use in kernels that calls ``kernel``, which is loaded before its callers.

    Args:
        kernel: from ``compiled`` or ``lean``.
        signature: its five to eight types: numba's signature, or as numba writes it.
    """
    if not hasattr(kernel, "overloads"):  # compilation is switched off
        return kernel
    callee = _callee(kernel, signature)

    def bring() -> None:
        address = _NOWHERE if _without_callees else callee.address()
        _codegen.ll.add_symbol(callee.name, address)

    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        kind = context.call_conv.get_function_type(callee.result, callee.arguments)
        function = _cgutils.get_or_insert_function(builder.module, kind, callee.name)
        return _call(context, builder, function, callee, values)

    return _usable(callee, bring, generate)


def linked_lazily(kernel: F, signature: Any) -> F:
    """As ``linked``; the first call compiles or loads ``kernel``, which then stays.

    An exception meanwhile, as KeyboardInterrupt, is raised by the outermost kernel.
    """
    if not hasattr(kernel, "overloads"):
        return kernel
    callee = _callee(kernel, signature)
    address = c_size_t(0)

    def bind() -> None:
        address.value = callee.address()

    def declare() -> None:
        _codegen.ll.add_symbol(f"{callee.name}:address", addressof(address))
        _codegen.ll.add_symbol(f"{callee.name}:bind", id(bind))

    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        word = context.get_value_type(_types.uintp)
        place = _external(builder.module, word, f"{callee.name}:address")
        with _cgutils.if_unlikely(builder, _cgutils.is_null(builder, builder.load(place))):
            _call_python(context, builder, f"{callee.name}:bind")
        kind = context.call_conv.get_function_type(callee.result, callee.arguments)
        function = builder.inttoptr(builder.load(place), kind.as_pointer())
        return _call(context, builder, function, callee, values)

    return _usable(callee, declare, generate)


class _Callee(NamedTuple):
    """A kernel that other kernels call by its name."""

    name: str
    arguments: tuple[Any, ...]
    result: Any
    address: Callable[[], int]
    """Compiles or loads the kernel, if need be, and gives its address."""


def _callee(kernel: Callable[..., Any], signature: Any) -> _Callee:
    """The kernel for one signature."""
    dispatcher: Any = kernel
    arguments, result = _sigutils.normalize_signature(signature)
    found: list[int] = []

    def address() -> int:
        if not found:
            with apart():
                dispatcher.compile(arguments)
            overload = dispatcher.overloads[arguments]
            found.append(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))
        return found[0]

    name = f"{dispatcher.__module__}.{dispatcher.__name__}"
    return _Callee(name, arguments, result, address)


def _usable(callee: _Callee, resolve: Callable[[], None], generate: Callable[..., Any]) -> Any:
    """A function for use in kernels, whose names are resolved before a caller is loaded."""

    def call_with_five(_: Any, _a: Any, _b: Any, _c: Any, _d: Any, _e: Any) -> Any:
        resolve()
        return callee.result(*callee.arguments), generate

    def call_with_six(_: Any, a: Any, b: Any, c: Any, d: Any, e: Any, _f: Any) -> Any:
        return call_with_five(_, a, b, c, d, e)

    def call_with_seven(_: Any, a: Any, b: Any, c: Any, d: Any, e: Any, _f: Any, _g: Any) -> Any:
        return call_with_five(_, a, b, c, d, e)

    def call_with_eight(
        _: Any, a: Any, b: Any, c: Any, d: Any, e: Any, _f: Any, _g: Any, _h: Any
    ) -> Any:
        return call_with_five(_, a, b, c, d, e)

    _resolve[callee.name] = resolve
    calls = {5: call_with_five, 6: call_with_six, 7: call_with_seven, 8: call_with_eight}
    return _intrinsic(calls[len(callee.arguments)])


def _call(context: Any, builder: Any, function: Any, callee: _Callee, values: Any) -> Any:
    """Call a function of numba's calling convention, and pass on what it raises."""
    status, value = context.call_conv.call_function(
        builder, function, callee.result, callee.arguments, values
    )
    with _cgutils.if_unlikely(builder, status.is_error):
        context.call_conv.return_status_propagate(builder, status)
    return value


def _external(module: Any, kind: Any, name: str) -> Any:
    """A variable outside of the machine code."""
    if name in module.globals:
        return module.globals[name]
    return _cgutils.add_global_variable(module, kind, name)


def _call_python(context: Any, builder: Any, name: str) -> None:
    """Call the Python function without arguments that has a name, with the interpreter's lock.

    What it raises is raised by the outermost kernel.
    """
    python = context.get_python_api(builder)
    lock = python.gil_ensure()
    function = _external(builder.module, _cgutils.int8_t, name)
    answer = python.call_function_objargs(function, ())
    failed = _cgutils.is_null(builder, answer)
    with builder.if_then(builder.not_(failed)):
        python.decref(answer)
    python.gil_release(lock)
    with _cgutils.if_unlikely(builder, failed):
        context.call_conv.return_exc(builder)
