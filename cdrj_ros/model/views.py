"""Views of parts of one flat vector, which holds numbers and rows of several kinds.

Nothing is copied.  Python runs these functions as written.  Inside kernels a view is an address
and a shape (``cdrj_ros.model.view_type``); checking bounds and counting references would take
longer than the sample itself, so neither is done.  The vector must outlive the view, as an argument
of the kernel does.
"""

from __future__ import annotations

from typing import Any, Final, TypeVar

from numba import types
from numba.core import cgutils, imputils
from numba.extending import lower_builtin, type_callable
from numpy.typing import NDArray

from cdrj_ros.model.compiled import usable_in_kernels
from cdrj_ros.model.records import words
from cdrj_ros.model.view_type import View, address_of, make_view

T = TypeVar("T")

_cgutils: Final[Any] = cgutils  # numba has no types of its own
_borrowed: Final[Any] = imputils.impl_ret_borrowed
_lower: Final[Any] = lower_builtin
_types: Final[Any] = types


def part(vector: NDArray[Any], begin: int, end: int) -> NDArray[Any]:
    """The part of a vector, or in Python of every row of a table, from ``begin`` to ``end``."""
    return vector[..., begin:end]


def rows(vector: NDArray[Any], begin: int, end: int, record: Any) -> Any:
    """That part as rows of a record type, whose fields take 8 bytes each."""
    return vector[..., begin:end].view(record)


def table(vector: NDArray[Any], begin: int, height: int, width: int) -> NDArray[Any]:
    """``height`` rows of ``width`` numbers from ``begin`` on."""
    return vector[begin : begin + height * width].reshape(height, width)


def grid(vector: NDArray[Any], begin: int, height: int, width: int, record: Any) -> Any:
    """``height`` by ``width`` rows of a record type from ``begin`` on."""
    end = begin + height * width * words(record)
    return vector[begin:end].view(record).reshape(height, width)


def views_of(arrays: T) -> T:
    """A named tuple of arrays, with a view for each of them in a kernel.

    Arrays that are not contiguous remain arrays.  Tuples in the tuple are converted alike.
    """
    return arrays


@usable_in_kernels
def copy_part(source: NDArray[Any], begin: int, target: NDArray[Any]) -> None:
    """Fill ``target`` with ``source`` from ``begin`` on; the two must not overlap.

    An assignment of slices takes five times as long, because numba allows for an overlap.
    """
    for k in range(target.size):
        target[k] = source[begin + k]


@usable_in_kernels
def is_dense(vector: NDArray[Any]) -> bool:
    """Whether a vector is contiguous, which the types of entry points state and do not check."""
    return vector.size < 2 or vector.strides[0] == vector.itemsize


def _view_type(vector: Any, dimensions: int, record: Any = None) -> Any:
    """Type of a view in a kernel; for anything but a flat vector None, which numba rejects."""
    if isinstance(vector, View) and vector.dimensions == 1:
        item, mutable = vector.item, vector.mutable
    elif isinstance(vector, types.Array) and vector.ndim == 1 and vector.layout == "C":
        item, mutable = vector.dtype, vector.mutable
    else:
        return None
    return View(item if record is None else record.dtype, dimensions, mutable)


@type_callable(part)
def _part_type(_context: Any) -> Any:
    def typer(vector: Any, _begin: Any, _end: Any) -> Any:
        return _view_type(vector, 1)

    return typer


@type_callable(rows)
def _rows_type(_context: Any) -> Any:
    def typer(vector: Any, _begin: Any, _end: Any, record: Any) -> Any:
        return _view_type(vector, 1, record)

    return typer


@type_callable(table)
def _table_type(_context: Any) -> Any:
    def typer(vector: Any, _begin: Any, _height: Any, _width: Any) -> Any:
        return _view_type(vector, 2)

    return typer


@type_callable(grid)
def _grid_type(_context: Any) -> Any:
    def typer(vector: Any, _begin: Any, _height: Any, _width: Any, record: Any) -> Any:
        return _view_type(vector, 2, record)

    return typer


@_lower(part, types.Any, types.Integer, types.Integer)
@_lower(rows, types.Any, types.Integer, types.Integer, types.DType)
def _lower_line(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    begin, end = (
        context.cast(builder, arguments[k], signature.args[k], types.intp) for k in (1, 2)
    )
    size = context.get_abi_sizeof(context.get_data_type(signature.return_type.item))
    count = builder.sdiv(builder.sub(end, begin), context.get_constant(types.intp, size // 8))
    return _from(context, builder, signature, arguments, [count])


@_lower(table, types.Any, types.Integer, types.Integer, types.Integer)
@_lower(grid, types.Any, types.Integer, types.Integer, types.Integer, types.DType)
def _lower_rectangle(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    shape = [context.cast(builder, arguments[k], signature.args[k], types.intp) for k in (2, 3)]
    return _from(context, builder, signature, arguments, shape)


def _from(context: Any, builder: Any, signature: Any, arguments: Any, shape: list[Any]) -> Any:
    """The view of the vector that begins where the second argument says."""
    begin = context.cast(builder, arguments[1], signature.args[1], types.intp)
    kind = signature.return_type
    data = _cgutils.pointer_add(
        builder,
        address_of(context, builder, signature.args[0], arguments[0]),
        builder.mul(begin, context.get_constant(types.intp, 8)),
        context.get_data_type(kind.item).as_pointer(),
    )
    return make_view(context, builder, kind, data, shape)


def _viewed(kind: Any) -> Any:
    """Type of what ``views_of`` makes of a type."""
    if isinstance(kind, types.Array) and kind.layout == "C":
        return View(kind.dtype, kind.ndim, kind.mutable)
    if isinstance(kind, types.NamedTuple):
        return _types.NamedTuple([_viewed(one) for one in kind], kind.instance_class)
    return kind


@type_callable(views_of)
def _views_type(_context: Any) -> Any:
    return _viewed


@_lower(views_of, types.Any)
def _lower_views(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, wanted = signature.args[0], signature.return_type
    value = _as_viewed(context, builder, kind, wanted, arguments[0])
    return _borrowed(context, builder, wanted, value)  # arrays that remain keep their owners


def _as_viewed(context: Any, builder: Any, kind: Any, wanted: Any, value: Any) -> Any:
    """A value of one type as what ``views_of`` makes of it."""
    if kind == wanted:
        return value
    if isinstance(wanted, View):
        place = context.data_model_manager[kind].get_field_position("shape")
        counts = _cgutils.unpack_tuple(builder, builder.extract_value(value, place))
        data = address_of(context, builder, kind, value)
        return make_view(context, builder, wanted, data, counts)
    entries = [
        _as_viewed(context, builder, *kinds, builder.extract_value(value, place))
        for place, kinds in enumerate(zip(kind, wanted, strict=True))
    ]
    return context.make_tuple(builder, wanted, entries)
