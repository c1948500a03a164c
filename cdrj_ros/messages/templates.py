"""Encoding of messages whose names and array sizes stay the same, among them those of estimates."""

from __future__ import annotations

import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from cdrj_ros._core import END_OF_TIME_NS, MessageEncoder
from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    ENCAPSULATION,
    JOINT_STATE,
    NODAL_FORCES,
    TEXT,
    MessageError,
    MessageType,
    Span,
)
from cdrj_ros.model.packing import STALE, Layout


class Template:
    """An encoded message with fixed names and array sizes, into which numbers are patched.

    Every sequence in `arrays` has one value per name; the others are empty.  Little-endian.
    """

    def __init__(
        self,
        message: MessageType,
        names: Sequence[str],
        arrays: Collection[str] | None = None,
        frame_id: str = "",
    ) -> None:
        """Encode the message; `arrays` of None means all of its sequences of numbers."""
        sequences = [f.name for f in message.fields if f.code != TEXT and f.count == 0]
        chosen = set(sequences if arrays is None else arrays)
        if unknown := chosen.difference(sequences):
            raise MessageError(f"{message.name} has no arrays {sorted(unknown)}, but {sequences}")
        self.message = message
        self.names = tuple(names)
        self.spans: Mapping[str, Span]
        """Locations of the arrays given to `encode`, in the order of the message."""
        self.payload, self.spans = _blank(message, self.names, chosen, frame_id)
        self._buffer = bytearray(self.payload)
        self.views: Mapping[str, npt.NDArray[Any]] = {
            name: np.frombuffer(self._buffer, span.dtype, span.count, span.offset)
            for name, span in self.spans.items()
        }
        """The arrays of the next message that is encoded, each of shape (len(names),)."""
        self._stamp = struct.Struct("<iI")

    def encode(self, stamp_ns: int, **arrays: npt.ArrayLike) -> bytes:
        """Encode a message with this stamp and these arrays, each of shape (len(names),)."""
        views = self.views
        if len(arrays) != len(views):
            raise self._mismatch(arrays)
        try:
            for name, values in arrays.items():
                views[name][:] = values
        except (KeyError, ValueError):
            raise self._mismatch(arrays) from None
        return self.stamped(stamp_ns)

    def stamped(self, stamp_ns: int) -> bytes:
        """Encode a message with this stamp and what ``views`` hold."""
        try:
            self._stamp.pack_into(self._buffer, ENCAPSULATION, *divmod(stamp_ns, 1_000_000_000))
        except struct.error:
            raise MessageError(f"stamp {stamp_ns} ns does not fit a ROS header") from None
        return bytes(self._buffer)

    def encode_many(
        self,
        stamp_ns: npt.NDArray[np.int64],
        arrays: Mapping[str, npt.NDArray[Any]],
    ) -> npt.NDArray[np.uint8]:
        """Encode n messages as rows, shape (n, length).

        `stamp_ns` has shape (n,), each array shape (n, len(names)).
        """
        if set(arrays) != set(self.views):
            raise self._mismatch(arrays)
        n, width = len(stamp_ns), len(self.payload)
        rows = np.empty((n, width), np.uint8)
        if not n:
            return rows
        rows[:] = np.frombuffer(self.payload, np.uint8)
        sec, nanosec = np.divmod(stamp_ns, 1_000_000_000)
        if int(sec.min()) < -(2**31) or int(sec.max()) >= 2**31:
            raise MessageError("a stamp does not fit a ROS header (32-bit seconds)")
        at = ENCAPSULATION
        np.ndarray((n,), "<i4", rows, at, (width,))[:] = sec
        np.ndarray((n,), "<u4", rows, at + 4, (width,))[:] = nanosec
        for name, span in self.spans.items():
            strides = (width, np.dtype(span.dtype).itemsize)
            shape = (n, span.count)
            if np.shape(arrays[name]) != shape:
                raise self._mismatch(arrays)
            if span.count:
                np.ndarray(shape, span.dtype, rows, span.offset, strides)[:] = arrays[name]
        return rows

    def _mismatch(self, arrays: Mapping[str, npt.ArrayLike]) -> MessageError:
        given = {name: np.shape(values) for name, values in arrays.items()}
        return MessageError(
            f"{self.message.name} with {len(self.names)} names takes {list(self.spans)} "
            f"of as many values each, got {given}"
        )


def _blank(
    message: MessageType, names: tuple[str, ...], arrays: Collection[str], frame_id: str
) -> tuple[bytes, dict[str, Span]]:
    """A message of zeros, including encapsulation, and the locations of its arrays."""
    body = bytearray()
    spans: dict[str, Span] = {}

    def put(data: bytes, alignment: int) -> int:
        if data:
            body.extend(bytes(-len(body) % alignment))
        body.extend(data)
        return ENCAPSULATION + len(body) - len(data)

    def put_text(text: str) -> None:
        data = text.encode() + b"\0"
        put(struct.pack("<I", len(data)) + data, 4)

    for field in message.fields:
        if field.code == TEXT and field.count is None:
            put_text(frame_id if field.name == "header.frame_id" else "")
        elif field.code == TEXT:
            put(struct.pack("<I", len(names)), 4)
            for name in names:
                put_text(name)
        else:
            size = int(field.code[1:])
            count = 1 if field.count is None else field.count
            if field.count == 0:
                count = len(names) if field.name in arrays else 0
                put(struct.pack("<I", count), 4)
            offset = put(bytes(count * size), size)
            if field.name in arrays:
                spans[field.name] = Span(offset, count, "<" + field.code)
    return b"\0\1\0\0" + bytes(body), spans


FORCES: Final = tuple(
    field.name for field in NODAL_FORCES.fields if field.code == "f8" and field.name != "stddev"
)
"""Arrays that nodal forces and estimates have by the same names."""

NONE_KNOWN: Final = np.empty(0)
"""Standard deviations for messages without them."""


def marked_stale(estimate: Estimate) -> Estimate:
    """A copy of the estimate with every element marked ``STALE``."""
    values = estimate.values.copy()
    status = values[estimate.layout.status]
    status[:] = status.astype(np.uint8) | STALE
    return replace(estimate, values=values)


class Encoded(NamedTuple):
    """The messages of one estimate."""

    tensions: bytes
    """cdrj_msgs/CableTensions."""
    nodal_forces: bytes
    """cdrj_msgs/NodalForces; a pulley has the flags of both adjacent elements."""
    efforts: bytes
    """sensor_msgs/JointState with the efforts of all motors, then all joints [N m].

    The efforts are empty if any element is ``INVALID``, because the message has no status.
    """


class EstimateEncoder:
    """Encodes estimates of one robot as messages."""

    def __init__(self, layout: Layout, uncertain: bool = False) -> None:
        """Prepare the messages; their names are fixed.

        Args:
            layout: layout of the estimates.
            uncertain: whether the messages include standard deviations.
        """
        self._layout = layout
        axes, places = layout.motors + layout.joints, layout.stddev
        self._width = max(one.stop for one in places.values()) if uncertain else 0
        of_elements = [(k, k) for k in range(len(layout.elements))]
        of_pulleys = [(int(k), int(k) + 1) for k in layout.element_before]
        begins = [
            places[part].start if uncertain else None
            for part in ("tension", "magnitude", "motor_effort")
        ]
        prepare = partial(_encoder_of, layout)
        self._tensions = prepare(
            CABLE_TENSIONS, layout.elements, ("tension",), begins[0], beside=of_elements
        )
        self._nodal_forces = prepare(
            NODAL_FORCES, layout.pulleys, FORCES, begins[1], beside=of_pulleys
        )
        self._efforts = prepare(JOINT_STATE, axes, ("effort",))
        self._no_efforts = prepare(JOINT_STATE, axes)
        self._efforts_stddev = prepare(JOINT_STATE, axes, (), begins[2], "effort")

    def encode(self, estimate: Estimate) -> Encoded:
        """Encode all three messages.

        Args:
            estimate: of this robot.

        Raises:
            MessageError: an estimate of another robot, standard deviations where none are expected
                or none where they are, or a stamp that no header can hold.
        """
        stamp, values = estimate.stamp_ns, estimate.values
        stddevs = NONE_KNOWN if estimate.stddev is None else estimate.stddev
        if values.size != self._layout.size or stddevs.size != self._width:
            raise MessageError(
                f"the messages take {self._layout.size} values and {self._width} standard "
                f"deviations, got {values.size} and {stddevs.size}"
            )
        if not 0 <= stamp < END_OF_TIME_NS:
            raise MessageError(f"stamp {stamp} ns does not fit a ROS header")
        efforts = self._efforts if estimate.solved else self._no_efforts
        return Encoded(
            self._tensions.encode(stamp, values, stddevs),
            self._nodal_forces.encode(stamp, values, stddevs),
            efforts.encode(stamp, values, stddevs),
        )

    def efforts_stddev(self, estimate: Estimate) -> bytes:
        """Encode sensor_msgs/JointState with the standard deviations of the efforts [N m]."""
        encoder = self._efforts_stddev if estimate.solved else self._no_efforts
        stddevs = NONE_KNOWN if estimate.stddev is None else estimate.stddev
        return encoder.encode(estimate.stamp_ns, estimate.values, stddevs)


def _encoder_of(
    layout: Layout,
    message: MessageType,
    names: tuple[str, ...],
    values: Sequence[str] = (),
    first_stddev: int | None = None,
    stddev: str = "stddev",
    beside: Sequence[tuple[int, int]] = (),
) -> MessageEncoder:
    """Prepare a message of one robot.

    Args:
        layout: of its estimates.
        message: its type.
        names: its names.
        values: its arrays that are copied from the estimate.
        first_stddev: index of its first standard deviation; None: it has none.
        stddev: its array that holds the standard deviations.
        beside: for a message with status, the elements beside each of its names.
    """
    uncertain = first_stddev is not None
    arrays = (*values, *(("status",) if beside else ()), *((stddev,) if uncertain else ()))
    frame = layout.force_frame if message is NODAL_FORCES else layout.base_link
    blank = Template(message, names, arrays, frame)
    at = {array: span.offset for array, span in blank.spans.items()}
    status = layout.status.start
    return MessageEncoder(
        blank.payload,
        values=[(at[one], getattr(layout, one).start, len(names)) for one in values],
        stddevs=[(at[stddev], first_stddev, len(names))] if first_stddev is not None else [],
        flags=[
            (at["status"] + k, status + before, status + after)
            for k, (before, after) in enumerate(beside)
        ],
    )
