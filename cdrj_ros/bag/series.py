"""Time series of a recording's channels, assembled from decoded messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cdrj_ros.bag.batch import Int64s
from cdrj_ros.foundation.series import Series
from cdrj_ros.foundation.text import printable

Float64s = npt.NDArray[np.float64]


class Decoded:
    """Decoded values of the messages of one topic, one table for each list of names."""

    def __init__(self) -> None:
        """Start without messages."""
        self.tables: dict[tuple[str, ...], Table] = {}

    def add(
        self,
        names: tuple[str, ...],
        arrival: Int64s,
        log_ns: Int64s,
        stamp_ns: Int64s,
        value: Float64s,
    ) -> None:
        """Add messages with these names; the arrays have the shapes of `Table`."""
        table = self.tables.get(names)
        if table is None:
            table = self.tables[names] = Table(value.shape[1:])
        table.append(arrival, log_ns, stamp_ns, value)

    def extent(self) -> tuple[int, int]:
        """Earliest and latest log time [ns]."""
        times = [table.log_ns[: table.rows] for table in self.tables.values()]
        return min(int(log_ns.min()) for log_ns in times), max(int(x.max()) for x in times)


class Table:
    """Messages with the same names, in arrays that grow in place.

    Concatenating a list of small arrays at the end would need twice the memory.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        """`shape` of the values of one message: (names,) or (names, arrays)."""
        self.rows = 0
        self.arrival = np.empty(0, np.int64)
        """Index of each message in the order of the files, shape (capacity,)."""
        self.log_ns = np.empty(0, np.int64)
        self.stamp_ns = np.empty(0, np.int64)
        self.value = np.empty((0, *shape))

    def append(self, arrival: Int64s, log_ns: Int64s, stamp_ns: Int64s, value: Float64s) -> None:
        """Add rows; the arrays have shapes (m,), (m,), (m,) and (m, *shape)."""
        rows = self.rows + len(arrival)
        if rows > len(self.arrival):
            self._resize(rows + rows // 4)
        part = slice(self.rows, rows)
        self.arrival[part], self.log_ns[part] = arrival, log_ns
        self.stamp_ns[part], self.value[part] = stamp_ns, value
        self.rows = rows

    def trim(self) -> None:
        """Release unused capacity."""
        self._resize(self.rows)

    def _resize(self, capacity: int) -> None:
        for values in (self.arrival, self.log_ns, self.stamp_ns):
            values.resize(capacity, refcheck=False)
        self.value.resize((capacity, *self.value.shape[1:]), refcheck=False)


def series_by_name(parts: Iterable[Decoded]) -> dict[str, Series]:
    """Assemble the channels of one topic; this empties `parts`.

    Messages with equal log times keep the order of the file.  Arrays are contiguous and read-only;
    if all messages have the same names, the channels share their arrays of times.
    """
    tables: list[tuple[tuple[str, ...], Table]] = []
    for part in parts:
        tables += part.tables.items()
        part.tables.clear()
    for _, table in tables:
        table.trim()
    if not any(table.stamp_ns.any() for _, table in tables):
        for _, table in tables:
            table.stamp_ns = table.log_ns
    if len(tables) == 1 and len(set(tables[0][0])) == len(tables[0][0]):
        return _of_one_table(*tables.pop())
    return _of_several_tables(tables)


def _of_one_table(names: Sequence[str], table: Table) -> dict[str, Series]:
    order = _order(table.log_ns, table.arrival)
    del table.arrival
    stamp_ns, log_ns = _frozen(table.stamp_ns, order), _frozen(table.log_ns, order)
    return {
        printable(name): Series(stamp_ns, log_ns, _frozen(table.value[:, i], order))
        for i, name in enumerate(names)
    }


def _of_several_tables(tables: Sequence[tuple[Sequence[str], Table]]) -> dict[str, Series]:
    """As `series_by_name`, for messages that differ in their names or repeat a name."""
    columns: dict[str, list[tuple[Table, int]]] = {}
    for names, table in tables:
        for i, name in enumerate(names):
            columns.setdefault(name, []).append((table, i))
    found: dict[str, Series] = {}
    for name, places in columns.items():
        stamp_ns = np.concatenate([table.stamp_ns for table, _ in places])
        log_ns = np.concatenate([table.log_ns for table, _ in places])
        arrival = np.concatenate([table.arrival for table, _ in places])
        value = np.concatenate([table.value[:, i] for table, i in places])
        order = _order(log_ns, arrival)
        found[printable(name)] = Series(
            _frozen(stamp_ns, order), _frozen(log_ns, order), _frozen(value, order)
        )
    return found


def _order(log_ns: Int64s, arrival: Int64s) -> Int64s | None:
    """Permutation that sorts by log time, then by arrival; None if already sorted."""
    if (log_ns[1:] >= log_ns[:-1]).all() and (arrival[1:] > arrival[:-1]).all():
        return None
    return np.lexsort((arrival, log_ns))


def _frozen(values: npt.NDArray[Any], order: Int64s | None) -> npt.NDArray[Any]:
    values = np.ascontiguousarray(values if order is None else values[order])
    values.flags.writeable = False
    return values
