"""The last values of all elements and pulleys, for curves over time."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Layout
from cdrj_ros.view.snapshot import Snapshot, usable

Vector = NDArray[np.float64]

PICTURES: Final = 1800
"""Number of snapshots that are kept: one minute at 30 Hz."""


class Curves(NamedTuple):
    """Values over time at one place of a cable; NaN where unknown."""

    element: str
    pulley: str
    """The pulley next to the element; empty if there is none."""
    time_s: Vector
    """[s], shape (n,)."""
    tension: Vector
    """[N]."""
    stddev: Vector
    """[N]."""
    reference: Vector
    """[N]."""
    friction: Vector
    """At the pulley [N]."""
    slip_speed: Vector
    """At the pulley [m/s]."""


class Table(NamedTuple):
    """Snapshots over time."""

    stamp_ns: NDArray[np.int64]
    """[ns], shape (n,)."""
    tension: Vector
    """[N], shape (n, elements)."""
    stddev: Vector
    """[N], shape (n, elements)."""
    reference: Vector
    """[N], shape (n, elements)."""
    friction: Vector
    """[N], shape (n, pulleys)."""
    slip_speed: Vector
    """[m/s], shape (n, pulleys)."""

    def curves(self, layout: Layout, chosen: str, zero_ns: int) -> Curves:
        """The curves of an element or a pulley, with its neighbour.

        Args:
            layout: of the columns.
            chosen: as ``place_of`` takes it.
            zero_ns: stamp at which the time is 0 [ns].
        """
        element, pulley = place_of(layout, chosen)
        nothing = np.full(len(self.stamp_ns), np.nan)
        return Curves(
            layout.elements[element],
            "" if pulley is None else layout.pulleys[pulley],
            (self.stamp_ns - zero_ns).astype(np.float64) * 1e-9,
            self.tension[:, element],
            self.stddev[:, element],
            self.reference[:, element],
            nothing if pulley is None else self.friction[:, pulley],
            nothing if pulley is None else self.slip_speed[:, pulley],
        )


def place_of(layout: Layout, chosen: str) -> tuple[int, int | None]:
    """Indices of an element and of the pulley at one of its ends, of which ``chosen`` is one.

    Args:
        layout: of the robot.
        chosen: ``element cable/i`` or ``pulley cable/k``.
    """
    kind, _, name = chosen.partition(" ")
    if kind == "pulley":
        pulley = layout.pulleys.index(name)
        return int(layout.element_before[pulley]), pulley
    element = layout.elements.index(name)
    for neighbour in (element, element - 1):  # the pulley after the element, else before it
        found = np.flatnonzero(layout.element_before == neighbour)
        if found.size and layout.pulleys[found[0]].rpartition("/")[0] == name.rpartition("/")[0]:
            return element, int(found[0])
    return element, None


def choices(layout: Layout) -> tuple[str, ...]:
    """Everything that can be plotted, as ``place_of`` takes it."""
    return (
        *(f"element {name}" for name in layout.elements),
        *(f"pulley {name}" for name in layout.pulleys),
    )


class History:
    """A ring of snapshots."""

    def __init__(self, layout: Layout, size: int = PICTURES) -> None:
        """Reserve the memory for ``size`` snapshots."""
        elements, pulleys = len(layout.elements), len(layout.pulleys)
        self._stamp = np.zeros(size, np.int64)
        self._columns = [
            np.full((size, width), np.nan)
            for width in (elements, elements, elements, pulleys, pulleys)
        ]
        self._count = 0

    def clear(self) -> None:
        """Forget everything."""
        self._count = 0

    def add(self, shown: Snapshot) -> None:
        """Append a snapshot; a stamp that goes back clears the others, an equal one is ignored."""
        if self._count:
            before = self._stamp[(self._count - 1) % len(self._stamp)]
            if shown.stamp_ns == before:
                return
            if shown.stamp_ns < before:
                self.clear()
        k = self._count % len(self._stamp)
        self._stamp[k] = shown.stamp_ns
        fine, sure = usable(shown.status), usable(shown.pulley_status)
        self._columns[0][k] = np.where(fine, shown.tension, np.nan)
        self._columns[1][k] = np.where(fine, shown.stddev, np.nan)
        self._columns[2][k] = shown.reference
        self._columns[3][k] = np.where(sure, shown.friction, np.nan)
        self._columns[4][k] = np.where(sure, shown.slip_speed, np.nan)
        self._count += 1

    def table(self) -> Table:
        """All snapshots in the order of time."""
        size = len(self._stamp)
        if self._count <= size:
            order = np.arange(self._count)
        else:
            order = (np.arange(size) + self._count) % size
        return Table(self._stamp[order], *(column[order] for column in self._columns))
