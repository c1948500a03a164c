"""Parts of kernels have no machine code; what Python calls has, in every order of calls."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from support.warm import Programs

KERNELS = """
from cdrj_ros.model.compiled import callee, inlined, lean, stage

@callee
def halved(x):
    return 0.5 * x

@inlined
def doubled(x):
    return 2.0 * x

@stage
def kept(x):
    return halved(doubled(x))

@lean
def part(x):
    return halved(x) + 1.0

@lean
def whole(x):
    return part(part(x)) + halved(x)

@lean
def stepped(x):
    return kept(x)
"""

IN_TURN = """
from kernels import part, whole

print(whole(8.0), part(8.0), whole(8.0), part(4.0))
"""

AT_ONCE = """
import sys
from threading import Barrier, Thread
from kernels import part, whole

sys.setswitchinterval(1e-6)  # the threads take turns as often as they can
together = Barrier(2)
found = {}

def call(kernel):
    together.wait()
    found[kernel.__name__] = kernel(8.0)

threads = [Thread(target=call, args=(kernel,)) for kernel in (whole, part)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(found["whole"], found["part"])
"""

BY_A_KERNEL_OF_THE_USER = """
import numba
from kernels import halved, part

@numba.njit
def outer(x):
    return part(x) + halved(x)

print(outer(8.0), part(8.0))
"""

INLINED = """
from kernels import doubled, halved, kept, stepped

stepped(8.0)
for kernel in (kept, doubled, halved):
    (found,) = kernel.overloads.values()
    print(int(found.fndesc.inline))
"""


Run = Callable[[str], list[float]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "kernels.py").write_text(KERNELS, encoding="utf-8")
    return tmp_path


@pytest.fixture
def run(warm: Programs, folder: Path) -> Run:
    """Numbers that a program prints; its kernels are stored in the folder."""

    def numbers(program: str) -> list[float]:
        done = warm.run(folder, program, {**os.environ, "NUMBA_CACHE_DIR": str(folder)})
        assert done.returncode == 0, done.stderr
        return [float(word) for word in done.stdout.split()]

    return numbers


def stored(folder: Path) -> set[str]:
    """Names of the kernels whose machine code is on disk."""
    return {path.name.split(".")[1].partition("-")[0] for path in folder.rglob("*.nbc")}


def test_only_the_whole_kernel_is_stored(run: Run, folder: Path) -> None:
    assert run("from kernels import whole; print(whole(8.0))") == [7.5]
    assert stored(folder) == {"whole"}


def test_what_was_a_part_can_be_called_afterwards(run: Run, folder: Path) -> None:
    assert run(IN_TURN) == [7.5, 5.0, 7.5, 3.0]
    assert stored(folder) == {"whole", "part"}
    assert run(IN_TURN) == [7.5, 5.0, 7.5, 3.0], "loaded from disk"


def test_a_kernel_is_whole_while_another_thread_compiles_it_as_a_part(
    run: Run, folder: Path
) -> None:
    for _ in range(10):
        assert run(AT_ONCE) == [7.5, 5.0]
        for path in folder.rglob("*.nb?"):
            path.unlink()


def test_kernels_of_users_can_call_ours(run: Run) -> None:
    assert run(BY_A_KERNEL_OF_THE_USER) == [9.0, 5.0]


def test_what_an_inlined_stage_calls_is_inlined_only_where_it_says_so(run: Run) -> None:
    assert run(INLINED) == [1, 1, 0]
