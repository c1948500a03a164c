"""A log without ROS as a recording: a CSV file, a DataFrame or arrays by name."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Series, Stamps, Vector
from cdrj_ros.foundation.errors import BagError, UsageError
from cdrj_ros.foundation.files import InputError, read_regular
from cdrj_ros.foundation.output import printable
from cdrj_ros.recordings.recording import Recording

DELIMITERS: Final = ",;\t"
"""Of columns; the one that the first line has most often counts."""

NANOSECONDS_ABOVE: Final = 1e12
"""Times above this are in nanoseconds: as seconds they would be 30 000 years."""

SHORTEST_S: Final = 2e-5
"""Rows of a log are not closer [s]: no robot's bus is read at more than 50 kHz."""

LONGEST_S: Final = 1.0
"""Rows that are further apart show no motion [s]."""

TABLE_BYTES: Final = 1 << 31
"""Largest size of a CSV file: an hour of 20 columns at 1 kHz has 0.7 GB."""

KINDS: Final = ("motors", "joints", "tensions", "efforts")
"""Kinds of columns, see ``Columns``."""


@dataclass(frozen=True)
class Columns:
    """The columns of a table, by the names of the robot file."""

    time: str
    """Column of the times, in seconds, or in nanoseconds above ``NANOSECONDS_ABOVE``."""
    motors: Mapping[str, str] = field(default_factory=dict)
    """Columns of the motors' readings, before scale and offset of the robot file."""
    joints: Mapping[str, str] = field(default_factory=dict)
    """Columns of the joints' readings, likewise."""
    tensions: Mapping[str, str] = field(default_factory=dict)
    """Columns of measured tensions by element, as ``upper/8`` [N]: references."""
    efforts: Mapping[str, str] = field(default_factory=dict)
    """Columns of measured efforts of motors and joints, before their ``effort_scale``: references,
    or inputs for a robot with joints without encoder."""

    @classmethod
    def of(cls, document: Mapping[str, Any], source: str) -> Columns:
        """Check and take keys and values; ``source`` is named in errors."""
        if unknown := sorted(set(document) - {"time", *KINDS}):
            raise UsageError(
                f"{', '.join(map(repr, unknown))} is not a known key; known keys: "
                f"time, {', '.join(KINDS)} ({source})"
            )
        if not isinstance(document.get("time"), str):
            raise UsageError(f"time must be the name of a column ({source})")
        for kind in KINDS:
            named = document.get(kind, {})
            if not isinstance(named, Mapping) or not all(
                isinstance(word, str) for pair in named.items() for word in pair
            ):
                raise UsageError(f"{kind} must have a column for every name ({source})")
        if not document.get("motors"):
            raise UsageError(f"motors must have a column for at least one motor ({source})")
        return cls(document["time"], *(dict(document.get(kind, {})) for kind in KINDS))


def read_table(
    source: str | Path | Mapping[str, Any],
    *,
    time: str,
    motors: Mapping[str, str],
    joints: Mapping[str, str] | None = None,
    tensions: Mapping[str, str] | None = None,
    efforts: Mapping[str, str] | None = None,
) -> Recording:
    """Read a log without ROS, for ``validate`` and ``identify``.

    A cell that is empty or NaN is no reading, so columns may have rates of their own.

    Args:
        source: CSV file whose first line has the names of the columns, or a ``pandas.DataFrame``,
            or arrays by name.
        time: column of the times: seconds, from any zero, or nanoseconds.
        motors: columns by the names of the robot file, without its ``prefix`` or with it; readings
            as the sensors give them: scale, offset and period of the robot file are applied.
        joints: likewise.
        tensions: columns of load cells by element, as ``{"upper/8": "cell"}`` [N]; references.
        efforts: columns of efforts by motor or joint; ``effort_scale`` is applied; references.

    Returns:
        The recording.

    Raises:
        BagError: the file cannot be read, or has a cell that is no number.
        UsageError: a column is missing, or the times do not increase.
    """
    given = {
        "time": time, "motors": motors, "joints": joints or {}, "tensions": tensions or {},
        "efforts": efforts or {},
    }  # fmt: skip
    return table_with(source, Columns.of(given, "read_table"))


def table_with(source: str | Path | Mapping[str, Any], columns: Columns) -> Recording:
    """``read_table`` with columns that were checked."""
    wanted = [columns.time, *(name for kind in KINDS for name in getattr(columns, kind).values())]
    if isinstance(source, (str, Path)):
        path = Path(source)
        found = _from_csv(path, wanted)
    else:
        path = Path("table")
        found = _from_arrays(source, wanted)
    stamps = _stamps(found[columns.time], columns.time)

    def series(kind: str) -> dict[str, Series]:
        return {
            name: _series(stamps, found[column]) for name, column in getattr(columns, kind).items()
        }

    efforts = series("efforts")
    return Recording(
        path=path,
        start_ns=int(stamps[0]),
        end_ns=int(stamps[-1]),
        motors=series("motors"),
        joints=series("joints"),
        references={f"tension/{name}": one for name, one in series("tensions").items()}
        | {f"effort/{name}": one for name, one in efforts.items()},
        malformed={},
        notes=_unlikely(stamps, columns.time),
        motor_efforts=efforts,
        is_table=True,
    )


def _series(stamps: Stamps, values: Vector) -> Series:
    known = np.isfinite(values)
    return Series(stamps[known], stamps[known], np.ascontiguousarray(values[known]))


def _stamps(times: Vector, name: str) -> Stamps:
    """Times as nanoseconds above 0; a log that begins at 0 or before is shifted to begin at 1 s."""
    if not times.size or not np.isfinite(times).all():
        raise UsageError(f"column {name!r} must have a time in every row")
    exact = times.dtype.kind in "iu"
    in_ns = float(np.abs(times).max()) > NANOSECONDS_ABOVE
    scaled = times if in_ns and exact else np.rint(times * (1.0 if in_ns else 1e9))
    stamps: Stamps = scaled.astype(np.int64)
    if np.any(stamps[1:] <= stamps[:-1]):
        row = int(np.argmax(stamps[1:] <= stamps[:-1])) + 1
        raise UsageError(
            f"column {name!r} must increase by whole nanoseconds; row {row + 1} has "
            f"{times[row].item()!r} after {times[row - 1].item()!r}"
        )
    return stamps if stamps[0] > 0 else stamps - stamps[0] + 1_000_000_000


def _unlikely(stamps: Stamps, name: str) -> tuple[str, ...]:
    """A note on times that may be in another unit."""
    apart_s = 1e-9 * float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.1
    if SHORTEST_S <= apart_s <= LONGEST_S:
        return ()
    note = (
        f"Rows are {apart_s:.3g} s apart: column {printable(name)} must be in seconds, or in "
        f"nanoseconds above {NANOSECONDS_ABOVE:g}."
    )
    return (note,)


def _require(wanted: Sequence[str], there: Sequence[str], where: str) -> None:
    if missing := [name for name in wanted if name not in there]:
        raise UsageError(
            f"{where} has no column {', '.join(map(printable, missing))}; it has "
            f"{', '.join(map(printable, there)) or 'none'}"
        )


def _from_arrays(source: Mapping[str, Any], wanted: Sequence[str]) -> dict[str, Vector]:
    """Columns of a DataFrame, or arrays by name."""
    names = [str(name) for name in getattr(source, "columns", source)]
    _require(wanted, names, "the table")
    found = {name: np.asarray(source[name]) for name in wanted}
    for name, column in found.items():
        if column.ndim != 1 or column.dtype.kind not in "iuf":
            raise UsageError(f"column {name!r} must be numbers of shape (n,)")
        if column.shape != found[wanted[0]].shape:
            raise UsageError(f"column {name!r} must be as long as {wanted[0]!r}")
    return found


def _from_csv(path: Path, wanted: Sequence[str]) -> dict[str, Vector]:
    """The wanted columns of a CSV file; NaN where a cell is empty."""
    try:
        text = read_regular(path, TABLE_BYTES).decode("utf-8-sig")
    except InputError as error:
        raise BagError(f"{path} cannot be read: {error}") from None
    except UnicodeDecodeError:
        raise BagError(f"{path} is not UTF-8 text") from None
    lines = text.splitlines()
    head = lines[0] if lines else ""
    delimiter = max(DELIMITERS, key=head.count)
    rows = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    names = [name.strip() for name in next(rows, [])]
    _require(wanted, names, str(path))
    at = {name: names.index(name) for name in wanted}
    cells: dict[str, list[str]] = {name: [] for name in wanted}
    for number, row in enumerate(rows, 1):
        if any(row[len(names) :]):
            raise BagError(
                f"{path}: row {number} has {len(row)} cells, the first line {len(names)}; "
                "the decimal mark is a point"
            )
        for name, k in at.items() if row else ():
            cells[name].append(row[k].strip() if k < len(row) else "")
    return {name: _numbers(path, name, column) for name, column in cells.items()}


def _numbers(path: Path, name: str, cells: Sequence[str]) -> Vector:
    """Numbers of a column; whole numbers stay exact."""
    try:
        if all(cell.lstrip("+-").isdecimal() for cell in cells):
            return np.array([int(cell) for cell in cells], np.int64)
        return np.array([float(cell or "nan") for cell in cells])
    except (ValueError, OverflowError):
        row, cell = next((i, one) for i, one in enumerate(cells) if not _is_number(one))
        hint = "; the decimal mark is a point" if _is_number(cell.replace(",", ".")) else ""
        raise BagError(
            f"{path}: column {printable(name)}, row {row + 1} is no number: {cell[:40]!r}{hint}"
        ) from None


def _is_number(cell: str) -> bool:
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return abs(float(cell or "nan")) < 2.0**63 or "." in cell or "e" in cell.lower()
