"""Rows of structured arrays whose fields have names, ``pulleys[p].mu_c``, and vectors of them.

A record is declared as a class whose annotated fields are the fields of the row.  ``record_type``
turns it into a structured type, which NumPy stores and the compiled core reads.  The class itself
is never instantiated; type checkers read field names from it.  A vector holds numbers and rows of
several kinds, one ``Part`` after the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod
from typing import Any, Final, NamedTuple, Protocol, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

Row_co = TypeVar("Row_co", covariant=True)

_KINDS: Final[dict[str, Any]] = {"int": np.int64, "float": np.float64}


class Rows(Protocol[Row_co]):
    """A one-dimensional structured array; ``Row_co`` names the fields."""

    def __len__(self) -> int: ...

    @overload
    def __getitem__(self, place: int) -> Row_co: ...

    @overload
    def __getitem__(self, place: slice) -> Rows[Row_co]: ...

    def __setitem__(self, place: int, row: Any) -> None: ...


class Grid(Protocol[Row_co]):
    """A two-dimensional structured array; ``Row_co`` names the fields."""

    def __getitem__(self, place: tuple[int, int]) -> Row_co: ...


def record_type(fields: type, **vectors: int) -> Any:
    """Structured type with the annotated fields of a class, 8 bytes each and in their order.

    Args:
        fields: a class whose annotations are ``int``, ``float`` or ``Vector``; the fields of
            classes that it is derived from come first.
        vectors: length of every field annotated as ``Vector``.
    """
    columns: list[Any] = []
    inherited = [vars(base).get("__annotations__", {}) for base in reversed(fields.__mro__)]
    for name, kind in (field for one in inherited for field in one.items()):
        if hasattr(np.record, name):
            raise TypeError(f"{fields.__name__}.{name} is hidden by NumPy's own attribute")
        if name in vectors:
            columns.append((name, np.float64, (vectors[name],)))
        else:
            columns.append((name, _KINDS[kind]))
    return np.dtype((np.record, columns))


def code_of(kinds: Any, word: str) -> int:
    """Code of a kind in a row, by its word in a robot file.

    Args:
        kinds: an enumeration of the core: ``Guide``, ``Law``, ``Stribeck`` or ``FrameMotion``.
        word: the name of a member.
    """
    return int(kinds.__members__[word])


def words(record: Any) -> int:
    """Number of 8-byte words in a row."""
    return int(record.itemsize) // 8


class Part(NamedTuple):
    """One part of a vector."""

    shape: tuple[int, ...]
    """Of its view: one number, or the sizes of a table."""
    record: Any
    """Record type of its rows, whose fields take 8 bytes each; None for plain numbers."""
    size: int
    """Words of 8 bytes."""


def part(*shape: int, record: Any = None) -> Part:
    """A part of this shape."""
    return Part(shape, record, prod(shape) * (1 if record is None else words(record)))


def size_of(parts: Sequence[Part]) -> int:
    """Words of 8 bytes of all parts."""
    return sum(part.size for part in parts)


def views(vector: NDArray[Any], parts: Sequence[Part], begin: int = 0) -> Iterator[Any]:
    """A view of every part.

    Args:
        vector: in which the parts lie from ``begin`` on, or a table with such a vector in every
            row; the views then have the same first axis.
        parts: in their order.
        begin: where the first part begins.
    """
    for part in parts:
        end = begin + part.size
        view = vector[..., begin:end]
        if part.record is not None:
            view = view.view(part.record)
        yield view if len(part.shape) == 1 else view.reshape(part.shape)
        begin = end
