"""Views in kernels do what NumPy's do in Python."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError
from numpy.typing import NDArray

from cdrj_ros.model.records import record_type
from cdrj_ros.model.views import copy_part, grid, part, rows, table, views_of

Vector = NDArray[np.float64]

SOURCES = Path(__file__).parents[2] / "cdrj_ros"


class Pair:
    """A row of two numbers and a vector."""

    first: int
    second: float
    both: Vector


PAIR = record_type(Pair, both=2)


def numbers() -> Vector:
    return np.arange(40.0)


def of_a_part(vector: Vector) -> Any:
    view = part(vector, 3, 9)
    inner = view[2:5]
    inner[0] += 100.0
    view[4:] = -1.0
    rest = part(inner, 1, inner.size)
    return len(view), view.size, view.shape[0], inner[0], rest[0], len(view[5:]), len(view[6:])


def of_a_table(vector: Vector) -> Any:
    view = table(vector, 2, 4, 3)
    lower = view[1:3]
    lower[1, 2] = 50.0
    row = view[2]
    row[0] = row[2] + view[3, 1]
    view[3:] = 7.0
    return len(view), view.size, view.shape, lower.shape[0], lower[0, 1], row[0]


def of_rows(vector: Vector) -> Any:
    pairs = rows(vector, 4, 16, PAIR)
    pairs[1].second = 60.0
    pairs[1].both[1] = pairs[0].second
    pairs[2] = pairs[1]
    last = pairs[2:3][0]
    return len(pairs), last.second, last.both[1], pairs[0].second


def of_a_grid(vector: Vector) -> Any:
    pairs = grid(vector, 8, 2, 3, PAIR)
    pairs[1, 2].second = pairs[0, 1].second
    return pairs[1, 2].second, pairs[1, 2].both[0]


def of_all(vector: Vector) -> Any:
    view = part(vector, 0, vector.size)
    copy_part(vector, 20, part(view, 0, 5))
    view[10:12] = view[0]
    part(view, 30, 40)[:] = 0.5
    return view[0], view[11], view[39]


class Inner(NamedTuple):
    flags: NDArray[np.bool_]
    spaced: Vector


class Outer(NamedTuple):
    vector: Vector
    cube: NDArray[np.float64]
    inner: Inner
    count: int


def of_a_tuple(vector: Vector) -> Any:
    flags, spaced = np.zeros(3, dtype=np.bool_), vector[::2]
    outer = views_of(Outer(vector, vector[:24].reshape(2, 3, 4), Inner(flags, spaced), 7))
    outer.cube[1, 2, 3] = outer.vector[1] + outer.inner.spaced[3]
    outer.cube[1][1, 2] = -2.0
    outer.cube[1][0][:] = -3.0
    outer.inner.flags[1] = outer.count == 7
    shape = outer.cube.shape
    return shape, outer.cube.size, outer.cube[0, 1, 2], flags[1], flags[2], len(outer.cube[1:])


@pytest.mark.parametrize(
    "function", [of_a_tuple, of_a_part, of_a_table, of_rows, of_a_grid, of_all]
)
def test_a_kernel_reads_and_writes_as_python_does(function: Callable[[Vector], Any]) -> None:
    in_python, in_kernel = numbers(), numbers()
    expected = function(in_python)
    assert numba.njit(function)(in_kernel) == expected
    np.testing.assert_array_equal(in_kernel, in_python)
    assert not np.array_equal(in_kernel, numbers())


def test_a_view_of_what_cannot_be_written_cannot_be_written() -> None:
    fixed = numbers()
    fixed.flags.writeable = False

    @numba.njit
    def read(vector: Vector) -> float:
        return part(vector, 1, 3)[1]

    @numba.njit
    def write(vector: Vector) -> None:
        part(vector, 1, 3)[1] = 0.0

    assert read(fixed) == 2.0
    with pytest.raises(TypingError, match="setitem"):
        write(fixed)


KERNELS = {"compiled", "lean", "inlined", "callee", "stage", "usable_in_kernels"}


def counted_from_the_end(source: str) -> list[int]:
    """Lines in kernels with an index or a bound that is negative, which views do not know."""
    return [
        at.lineno
        for function in ast.walk(ast.parse(source))
        if isinstance(function, ast.FunctionDef)
        and KERNELS & {one.id for one in function.decorator_list if isinstance(one, ast.Name)}
        for at in ast.walk(function)
        if isinstance(at, ast.Subscript)
        for one in ast.walk(at.slice)
        if isinstance(one, ast.UnaryOp) and isinstance(one.op, ast.USub)
    ]


def test_no_kernel_counts_from_the_end() -> None:
    wrong = "@lean\ndef f(v):\n    v[0] = 1.0\n    return v[1:-1]\n\ndef g(v):\n    return v[-1]\n"
    assert counted_from_the_end(wrong) == [4]
    found = {
        str(path.relative_to(SOURCES)): lines
        for path in SOURCES.rglob("*.py")
        if (lines := counted_from_the_end(path.read_text(encoding="utf-8")))
    }
    assert found == {}


def test_a_kernel_that_takes_arrays_takes_views() -> None:
    @numba.njit(["float64(float64[::1])", "float64(float64[:, ::1])"])
    def takes(array: NDArray[np.float64]) -> Any:
        return array.sum() if array.ndim == 1 else array[1, 1:].sum() + array.strides[0]

    @numba.njit
    def total(vector: Vector) -> tuple[float, float]:
        return takes(part(vector, 1, 4)), takes(table(vector, 1, 2, 3))

    assert total(numbers()) == (6.0, 11.0 + 3 * 8)
