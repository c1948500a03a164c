"""Signatures of kernels, found by inferring types alone: most of a compilation is machine code."""

from __future__ import annotations

import sys
from typing import Any

from numba.core import compiler
from numba.core.caching import NullCache
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.typing import signature


@register_pass(mutates_CFG=False, analysis_only=True)
class _KeepTypes(FunctionPass):  # type: ignore[misc]
    """The last pass: the result of a compilation is its signature, without machine code."""

    _name = "keep_types"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        state["cr"] = compiler.compile_result(
            typing_context=state.typingctx,
            target_context=state.targetctx,
            signature=signature(state.return_type, *state.args),
            objectmode=False,
            entry_point=len,  # a built-in function, which numba requires; never called
        )
        return True


def _passes_of_types(pipeline: Any) -> list[Any]:
    """numba's passes up to the inference of types; that of a call compiles the called kernel."""
    build = compiler.DefaultPassBuilder
    passes = build.define_untyped_pipeline(pipeline.state)
    passes.passes.extend(build.define_typed_pipeline(pipeline.state).passes)
    passes.add_pass(_KeepTypes, "keep the types")
    passes.finalize()
    return [passes]


def count_signatures() -> dict[str, int]:
    """Number of signatures of every kernel for the calls that this process has made, by name.

    Kernels that were loaded from disk know only how Python has called them.  They are therefore
    compiled anew for these types, together with all kernels that they call.  No kernel can be
    called afterwards.
    """
    kernels = {
        f"{kernel.__module__}.{kernel.__name__}": kernel
        for name, module in list(sys.modules.items())
        if name.startswith("cdrj_ros.")
        for kernel in vars(module).values()
        if hasattr(kernel, "nopython_signatures")
    }
    called = [(kernel, list(kernel.overloads)) for kernel in kernels.values()]
    compiler.Compiler.define_pipelines = _passes_of_types
    for kernel in kernels.values():
        kernel._cache = NullCache()
        kernel.overloads.clear()
    for kernel, types in called:
        for arguments in types:
            kernel.compile(arguments)
    return {name: len(kernel.nopython_signatures) for name, kernel in kernels.items()}
