"""Memory to which an estimator returns after it has looked ahead."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray


class Snapshot:
    """Some arrays as they were, until they are so again."""

    def __init__(self, *arrays: NDArray[Any]) -> None:
        """Prepare for arrays that are only ever changed in place."""
        self._arrays = arrays
        self._kept: list[NDArray[Any]] = []

    @property
    def taken(self) -> bool:
        """Whether there is something to return to."""
        return bool(self._kept)

    def take(self) -> None:
        """Copy the arrays, unless that has been done."""
        if not self._kept:
            self._kept = [array.copy() for array in self._arrays]

    def restore(self) -> None:
        """Make the arrays what they were; without effect if nothing was copied."""
        for array, before in zip(self._arrays, self._kept, strict=False):
            array[:] = before
        self._kept = []

    def forget(self) -> None:
        """Discard the copies."""
        self._kept = []
