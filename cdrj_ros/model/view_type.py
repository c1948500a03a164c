"""The type of views in kernels: an address and a shape.

Numba passes an array as seven numbers, most of which a part of a vector does not need.  A sample
has sixty views, and passing those numbers on took a third of the code of its kernels.  A view has
two numbers, and one more for each further axis.

Kernels read and write views by index and by slice, and ask for length, size and shape.  Bounds are
not checked, and no index is negative.  Where a kernel that is called by name takes an array, numba
makes one of the view.
"""

from __future__ import annotations

import operator
from typing import Any, Final

from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing import templates
from numba.extending import (
    lower_builtin,
    lower_cast,
    lower_getattr,
    register_model,
    type_callable,
)
from numba.np import arrayobj

# numba has no types of its own
_arrays: Final[Any] = arrayobj
_cgutils: Final[Any] = cgutils
_lower: Final[Any] = lower_builtin
_lower_cast: Final[Any] = lower_cast
_lower_getattr: Final[Any] = lower_getattr
_models: Final[Any] = models
_signature: Final[Any] = templates.signature
_templates: Final[Any] = templates
_types: Final[Any] = types


class View(_types.Type):  # type: ignore[misc]
    """A part of a contiguous vector, with numbers or rows of the type ``item``."""

    def __init__(self, item: Any, dimensions: int, mutable: bool) -> None:
        self.item, self.dimensions, self.mutable = item, dimensions, mutable
        self.array = _types.Array(item, dimensions, "C", readonly=not mutable)
        super().__init__(f"View({self.array})")

    def entry(self) -> Any:
        """Type of what one index selects."""
        if self.dimensions == 1:
            return self.item
        return View(self.item, self.dimensions - 1, self.mutable)

    def can_convert_to(self, context: Any, other: Any) -> Any:
        """How well a view can be passed as ``other``, which may be an array."""
        return context.can_convert(self.array, other)


@register_model(View)
class _Model(_models.StructModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: View) -> None:
        counts = [(f"count{k}", _types.intp) for k in range(kind.dimensions)]
        super().__init__(manager, kind, [("data", _types.CPointer(kind.item)), *counts])


def make_view(context: Any, builder: Any, kind: View, data: Any, counts: list[Any]) -> Any:
    """A view in numba's representation, from its address and its shape."""
    view = context.get_constant_undef(kind)
    for place, number in enumerate((data, *counts)):
        view = builder.insert_value(view, number, place)
    return view


def address_of(context: Any, builder: Any, kind: Any, vector: Any) -> Any:
    """The address of a view or an array."""
    place = context.data_model_manager[kind].get_field_position("data")
    return builder.extract_value(vector, place)


def _counts(builder: Any, kind: View, view: Any) -> list[Any]:
    """The shape of a view."""
    return [builder.extract_value(view, 1 + k) for k in range(kind.dimensions)]


def _moved(builder: Any, kind: View, view: Any, places: list[Any]) -> Any:
    """The address of what indices of the first axes select."""
    place = places[0]
    for axis, count in enumerate(_counts(builder, kind, view)[1:], 1):
        place = builder.mul(place, count)
        if axis < len(places):
            place = builder.add(place, places[axis])
    return builder.gep(builder.extract_value(view, 0), [place], inbounds=True)


def _sliced(context: Any, builder: Any, kind: View, view: Any, bounds: Any) -> Any:
    """The view between two bounds, of which the second may lie beyond the end."""
    limits = context.make_helper(builder, _types.slice2_type, value=bounds)
    counts = _counts(builder, kind, view)
    beyond = builder.icmp_signed("<", limits.stop, counts[0])
    end = builder.select(beyond, limits.stop, counts[0])
    counts[0] = builder.sub(end, limits.start)
    data = _moved(builder, kind, view, [limits.start])
    return make_view(context, builder, kind, data, counts)


@_templates.infer_global(operator.getitem)
class _Getitem(_templates.AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, _: Any) -> Any:
        kind, place = arguments
        if not isinstance(kind, View):
            return None
        if isinstance(place, _types.Integer):
            return _signature(kind.entry(), kind, _types.intp)
        if place == _types.slice2_type:
            return _signature(kind, kind, place)
        if _selects_entry(kind, place):
            return _signature(kind.item, kind, _types.UniTuple(_types.intp, len(place)))
        return None


@_templates.infer_global(operator.setitem)
class _Setitem(_templates.AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, _: Any) -> Any:
        kind, place, _value = arguments
        if not isinstance(kind, View) or not kind.mutable:
            return None
        if isinstance(place, _types.Integer) and kind.dimensions == 1:
            return _signature(_types.none, kind, _types.intp, kind.item)
        if place == _types.slice2_type:
            return _signature(_types.none, kind, place, kind.item)
        if _selects_entry(kind, place):
            indices = _types.UniTuple(_types.intp, len(place))
            return _signature(_types.none, kind, indices, kind.item)
        return None


def _selects_entry(kind: View, place: Any) -> bool:
    """Whether an index is a tuple of as many integers as the view has axes."""
    return (
        isinstance(place, _types.BaseTuple)
        and len(place) == kind.dimensions
        and all(isinstance(one, _types.Integer) for one in place)
    )


@_lower(operator.getitem, View, _types.Integer)
def _get_entry(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, (view, place) = signature.args[0], arguments
    address = _moved(builder, kind, view, [place])
    if kind.dimensions > 1:
        counts = _counts(builder, kind, view)[1:]
        return make_view(context, builder, kind.entry(), address, counts)
    return _arrays.load_item(context, builder, kind.array, address)


@_lower(operator.getitem, View, _types.SliceType)
def _get_slice(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return _sliced(context, builder, signature.args[0], *arguments)


@_lower(operator.getitem, View, _types.BaseTuple)
def _get_from_table(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, (view, places) = signature.args[0], arguments
    address = _moved(builder, kind, view, _cgutils.unpack_tuple(builder, places))
    return _arrays.load_item(context, builder, kind.array, address)


@_lower(operator.setitem, View, _types.Integer, _types.Any)
def _set_entry(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, (view, place, value) = signature.args[0], arguments
    address = _moved(builder, kind, view, [place])
    _arrays.store_item(context, builder, kind.array, value, address)
    return context.get_dummy_value()


@_lower(operator.setitem, View, _types.BaseTuple, _types.Any)
def _set_in_table(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, (view, places, value) = signature.args[0], arguments
    address = _moved(builder, kind, view, _cgutils.unpack_tuple(builder, places))
    _arrays.store_item(context, builder, kind.array, value, address)
    return context.get_dummy_value()


@_lower(operator.setitem, View, _types.SliceType, _types.Any)
def _fill_slice(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, (view, bounds, value) = signature.args[0], arguments
    filled = _sliced(context, builder, kind, view, bounds)
    data, count = builder.extract_value(filled, 0), _size(builder, kind, filled)
    with _cgutils.for_range(builder, count) as loop:
        address = builder.gep(data, [loop.index], inbounds=True)
        _arrays.store_item(context, builder, kind.array, value, address)
    return context.get_dummy_value()


@type_callable(len)
def _length_type(_context: Any) -> Any:
    def typer(kind: Any) -> Any:
        return _types.intp if isinstance(kind, View) else None

    return typer


@_lower(len, View)
def _length(_: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
    return builder.extract_value(arguments[0], 1)


@_templates.infer_getattr
class _Attributes(_templates.AttributeTemplate):  # type: ignore[misc]
    key = View

    def resolve_size(self, _: View) -> Any:
        return _types.intp

    def resolve_shape(self, kind: View) -> Any:
        return _types.UniTuple(_types.intp, kind.dimensions)


def _size(builder: Any, kind: View, view: Any) -> Any:
    """Number of entries of a view."""
    first, *others = _counts(builder, kind, view)
    for count in others:
        first = builder.mul(first, count)
    return first


@_lower_getattr(View, "size")
def _get_size(_: Any, builder: Any, kind: View, view: Any) -> Any:
    return _size(builder, kind, view)


@_lower_getattr(View, "shape")
def _get_shape(_: Any, builder: Any, kind: View, view: Any) -> Any:
    return _cgutils.pack_array(builder, _counts(builder, kind, view))


@_lower_cast(View, _types.Array)
def _as_array(context: Any, builder: Any, kind: View, wanted: Any, view: Any) -> Any:
    """An array without an owner, for a kernel that is called by name."""
    array = _arrays.make_array(wanted)(context, builder)
    counts = _counts(builder, kind, view)
    size = context.get_abi_sizeof(context.get_data_type(kind.item))
    step = itemsize = context.get_constant(_types.intp, size)
    strides: list[Any] = []
    for count in reversed(counts):
        strides.insert(0, step)
        step = builder.mul(step, count)
    _arrays.populate_array(
        array,
        data=builder.extract_value(view, 0),
        shape=counts,
        strides=strides,
        itemsize=itemsize,
        meminfo=None,
    )
    return array._getvalue()
