"""Rows of structured arrays whose fields have names, ``pulleys[p].mu_c``, and vectors of them.

The records are those of the core, whose headers describe their fields: ``robot_records.hpp`` and
``state_records.hpp``.  A vector holds numbers and rows of several kinds, one ``Part`` after the
other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core

Rows = Any
"""A structured array, whose rows have the fields of a record as attributes."""


def _rows_of(record: np.dtype[Any]) -> Any:
    """The type of rows of a record, with vectors and matrices as arrays of their numbers."""
    columns: list[Any] = []
    for name in record.names or ():
        field = record[name]
        kind = np.int64 if field.kind == "i" else np.float64
        columns.append((name, kind, (field.itemsize // 8,) if field.itemsize > 8 else ()))
    return np.dtype((np.record, columns))


RECORDS: Final = {name: _rows_of(record) for name, record in _core.RECORDS.items()}
"""Types of rows by the name of the record."""


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
