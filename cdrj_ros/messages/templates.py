"""Encoding of messages whose names and array sizes stay the same, among them those of estimates."""

from __future__ import annotations

import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from cdrj_ros._core import END_OF_TIME_NS, MessageEncoder
from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.messages import topics
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
from cdrj_ros.model.packing import INVALID, STALE, Layout


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


class EstimateMessage(NamedTuple):
    """One of the messages with which an estimator answers."""

    topic: str
    message: MessageType
    arrays: tuple[str, ...]
    """Its arrays that are parts of the estimate by the same names."""
    uncertain: str = ""
    """Part of the estimate whose standard deviations it has; empty for none."""

    def names(self, layout: Layout) -> tuple[str, ...]:
        """Names in it."""
        names = {CABLE_TENSIONS: layout.elements, NODAL_FORCES: layout.pulleys}
        return names.get(self.message, layout.motors + layout.joints)

    def frame(self, layout: Layout) -> str:
        """Its ``frame_id``."""
        return layout.force_frame if self.message is NODAL_FORCES else layout.base_link

    def beside(self, layout: Layout) -> Sequence[tuple[int, int]]:
        """Elements whose flags are united in the status of each name; none without status."""
        if self.message is NODAL_FORCES:
            return [(int(k), int(k) + 1) for k in layout.element_before]
        return [(k, k) for k in range(len(self.names(layout)))] if self.uncertain else []


ESTIMATE_MESSAGES: Final = (
    EstimateMessage(topics.TENSIONS, CABLE_TENSIONS, ("tension",), "tension"),
    EstimateMessage(topics.NODAL_FORCES, NODAL_FORCES, FORCES, "magnitude"),
    EstimateMessage(topics.EFFORTS, JOINT_STATE, ("effort",)),
)
"""Tensions, forces on pulleys, and efforts of all motors, then all joints."""

MOST_TEMPLATES: Final = 32
"""Number of sets of known names for which messages are kept."""

NONE_KNOWN: Final = np.empty(0)
"""Standard deviations for messages without them."""


def marked_stale(estimate: Estimate) -> Estimate:
    """A copy of the estimate with every element marked ``STALE``."""
    values = estimate.values.copy()
    status = values[estimate.layout.status]
    status[:] = status.astype(np.uint8) | STALE
    return replace(estimate, values=values)


def known_elements(estimate: Estimate) -> npt.NDArray[np.bool_]:
    """Whether the numbers of every element are those at the estimate's time, shape (elements,)."""
    known: npt.NDArray[np.bool_] = (estimate.status.astype(np.uint8) & (STALE | INVALID)) == 0
    return known


class KnownEfforts:
    """Encodes JointStates with the efforts that are known, since such a message has no status."""

    def __init__(self, names: Sequence[str], frame_id: str) -> None:
        """Prepare for these names."""
        self._names, self._frame_id = np.array(names, dtype=object), frame_id
        self._templates: dict[bytes, Template] = {}
        """Of those that are known, by which these are."""

    def encode(
        self, stamp_ns: int, efforts: npt.NDArray[np.float64], known: npt.NDArray[np.bool_]
    ) -> bytes:
        """Encode the efforts of all names, of which these are known."""
        key = known.tobytes()
        if key not in self._templates:
            if len(self._templates) >= MOST_TEMPLATES:
                self._templates.clear()
            names = tuple(self._names[known])
            self._templates[key] = Template(JOINT_STATE, names, ("effort",), self._frame_id)
        return self._templates[key].encode(stamp_ns, effort=efforts[known])


class Encoded(NamedTuple):
    """The messages of one estimate."""

    tensions: bytes
    """cdrj_msgs/CableTensions."""
    nodal_forces: bytes
    """cdrj_msgs/NodalForces; a pulley has the flags of both adjacent elements."""
    efforts: bytes
    """sensor_msgs/JointState with the efforts of all motors, then all joints [N m].

    Those with a cable that is ``INVALID`` or whose axes are not read are left out, because the
    message has no status; if all are, it has names alone.
    """


class EstimateEncoder:
    """Encodes estimates of one robot as messages."""

    def __init__(
        self,
        layout: Layout,
        uncertain: bool = False,
        touched: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        """Prepare the messages; their names are fixed, but for efforts that are not known.

        Args:
            layout: layout of the estimates.
            uncertain: whether the messages include standard deviations.
            touched: by axes, the elements that have a part in its effort; None: all.
        """
        self._layout = layout
        axes = (*layout.motors, *layout.joints)
        self._touched = np.ones((len(axes), len(layout.elements)), np.bool_)
        if touched is not None:
            self._touched = touched
        self._known_efforts = KnownEfforts(axes, layout.base_link)
        places = layout.stddev
        self._width = max(one.stop for one in places.values()) if uncertain else 0
        self._tensions, self._nodal_forces, self._efforts = (
            _encoder_of(layout, one, "stddev", one.uncertain if uncertain else "")
            for one in ESTIMATE_MESSAGES
        )
        efforts = ESTIMATE_MESSAGES[2]._replace(arrays=())
        self._no_efforts = _encoder_of(layout, efforts)
        self._efforts_stddev = _encoder_of(
            layout, efforts, "effort", "motor_effort" if uncertain else ""
        )

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
        return Encoded(
            self._tensions.encode(stamp, values, stddevs),
            self._nodal_forces.encode(stamp, values, stddevs),
            self._encode_efforts(self._efforts, estimate, values[self._layout.effort]),
        )

    def _encode_efforts(
        self, whole: MessageEncoder, estimate: Estimate, numbers: npt.NDArray[np.float64]
    ) -> bytes:
        """Encode numbers of all axes, which are those of ``whole``, as far as they are known."""
        stamp, stddevs = estimate.stamp_ns, estimate.stddev
        if not estimate.solved:
            known = ~(self._touched @ ~known_elements(estimate))
            if known.any():
                return self._known_efforts.encode(stamp, numbers, known)
            whole = self._no_efforts
        return whole.encode(stamp, estimate.values, NONE_KNOWN if stddevs is None else stddevs)

    def efforts_stddev(self, estimate: Estimate) -> bytes:
        """Encode sensor_msgs/JointState with the standard deviations of the efforts [N m]."""
        assert estimate.stddev is not None
        motors, joints = (self._layout.stddev[one] for one in ("motor_effort", "joint_effort"))
        numbers = estimate.stddev[motors.start : joints.stop]
        return self._encode_efforts(self._efforts_stddev, estimate, numbers)


def _encoder_of(
    layout: Layout, one: EstimateMessage, stddev: str = "", uncertain: str = ""
) -> MessageEncoder:
    """Prepare a message of one robot.

    Args:
        layout: of its estimates.
        one: the message.
        stddev: its array that holds standard deviations,
        uncertain: and the part of the estimate that has them; empty: they are left out.
    """
    names, beside = one.names(layout), one.beside(layout)
    arrays = (*one.arrays, *(("status",) if beside else ()), *((stddev,) if uncertain else ()))
    blank = Template(one.message, names, arrays, one.frame(layout))
    at = {array: span.offset for array, span in blank.spans.items()}
    status = layout.status.start
    return MessageEncoder(
        blank.payload,
        values=[(at[part], getattr(layout, part).start, len(names)) for part in one.arrays],
        stddevs=[(at[stddev], layout.stddev[uncertain].start, len(names))] if uncertain else [],
        flags=[
            (at["status"] + k, status + before, status + after)
            for k, (before, after) in enumerate(beside)
        ],
    )
