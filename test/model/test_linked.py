"""Kernels that are bound with their first call are neither compiled nor loaded before."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from support.warm import Programs

KERNELS = """
from cdrj_ros.model.compiled import compiled, lean
from cdrj_ros.model.linked import linked, linked_lazily

FLOATS = "float64(float64, float64, float64, float64, float64, float64)"

@compiled
def added(a, b, c, d, e, f):
    if f < 0.0:
        raise ValueError("refused by the callee")
    return a + b + c + d + e + f

added_lazily = linked_lazily(added, FLOATS)

@lean
def middle(a, b, c, d, e, f):
    return added_lazily(a, b, c, d, e, f) if a > 0.0 else 0.0

middle_by_name = linked(middle, FLOATS)

@lean
def outer(a, f):
    return middle_by_name(a, 1.0, 1.0, 1.0, 1.0, f)
"""

BOUND = """
from kernels import added, outer

print(outer(0.0, 1.0), bool(added.overloads))
print(outer(3.0, 1.0), bool(added.overloads))
try:
    outer(3.0, -1.0)
except ValueError as error:
    print(error)
print(outer(3.0, 2.0))
"""

INTERRUPTED = """
from kernels import added, outer

really = added.compile
raised = [KeyboardInterrupt("once"), MemoryError("twice")]

def compile(signature):
    if raised:
        raise raised.pop(0)
    return really(signature)

added.compile = compile
for _ in range(3):
    try:
        print(outer(3.0, 1.0))
    except BaseException as error:
        print(type(error).__name__, error)
"""

AT_ONCE = """
import sys
from threading import Barrier, Thread
from kernels import outer

sys.setswitchinterval(1e-6)  # the threads take turns as often as they can
outer(0.0, 1.0)
together = Barrier(4)
found = []

def call(k):
    together.wait()
    found.append(outer(float(k), 1.0))

threads = [Thread(target=call, args=(k,)) for k in (1, 2, 3, 4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(sorted(found))
"""

Run = Callable[[str], list[str]]


@pytest.fixture
def run(warm: Programs, tmp_path: Path) -> Run:
    """Lines that a program prints; its kernels are stored in a folder."""
    (tmp_path / "kernels.py").write_text(KERNELS, encoding="utf-8")

    def lines(program: str) -> list[str]:
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        done = warm.run(tmp_path, program, environment)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return lines


def test_a_kernel_is_bound_with_its_first_call_whether_its_callers_are_compiled_or_loaded(
    run: Run, tmp_path: Path
) -> None:
    for _ in range(2):
        assert run(BOUND) == ["0.0 False", "8.0 True", "refused by the callee", "9.0"]
        names = {path.name.partition("-")[0] for path in tmp_path.rglob("*.nbc")}
        assert names == {"kernels.added", "kernels.middle", "kernels.outer"}


def test_what_binding_raises_is_raised_and_the_next_call_binds(run: Run) -> None:
    assert run(INTERRUPTED) == ["KeyboardInterrupt once", "MemoryError twice", "8.0"]


def test_threads_may_bind_a_kernel_at_once(run: Run, tmp_path: Path) -> None:
    for _ in range(5):
        assert run(AT_ONCE) == ["[6.0, 7.0, 8.0, 9.0]"]
        for path in tmp_path.rglob("kernels.added-*.nb?"):
            path.unlink()
