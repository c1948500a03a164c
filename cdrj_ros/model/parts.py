"""Views of parts of one flat vector, which holds numbers and rows of several kinds."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from cdrj_ros.model.records import words


def part(vector: NDArray[Any], begin: int, end: int) -> NDArray[Any]:
    """The part of a vector, or of every row of a table, from ``begin`` to ``end``."""
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
