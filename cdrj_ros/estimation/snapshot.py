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
        self.taken = False
        """Whether there is something to return to."""

    def take(self) -> None:
        """Copy the arrays, unless that has been done."""
        if not self.taken:
            self._kept, self.taken = [array.copy() for array in self._arrays], True

    def restore(self) -> None:
        """Make the arrays what they were; without effect if nothing was copied."""
        if self.taken:
            for array, before in zip(self._arrays, self._kept, strict=True):
                array[:] = before
            self.forget()

    def forget(self) -> None:
        """Discard the copies."""
        self._kept, self.taken = [], False
