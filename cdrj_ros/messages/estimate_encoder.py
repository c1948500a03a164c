"""Encoding of estimates as messages, all three of a sample at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import FLOAT, Estimate, as_plain
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    ENCAPSULATION,
    JOINT_STATE,
    NODAL_FORCES,
    MessageError,
    Span,
)
from cdrj_ros.messages.conversions import FORCES
from cdrj_ros.messages.frames import BEFORE, Frame, word_of, words_of
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.compiled import direct, lean
from cdrj_ros.model.prepared import Layout
from cdrj_ros.model.records import Rows, record_type
from cdrj_ros.model.views import is_dense

Vector = NDArray[np.float64]
Words = NDArray[np.int64]

END_OF_TIME_NS: Final = 2**31 * 1_000_000_000
"""The stamp of a header, whose seconds have 32 bits with a sign, is below this [ns]."""

NO_STDDEV: Final = np.empty(0)


class CopiedRecord:
    """Numbers that are copied from an estimate or its standard deviations into a message."""

    to: int
    """Word of the first one in the messages."""
    begin: int
    """Place of the first one among the estimate's values, or among the standard deviations."""
    count: int
    deviation: int
    """Whether they are standard deviations."""


class FlagRecord:
    """One status in a message: the union of the flags of two elements, which may be the same."""

    to: int
    """Byte in the messages."""
    one: int
    """Places of the elements' status among the estimate's values."""
    other: int


COPIED: Final = record_type(CopiedRecord)
FLAG: Final = record_type(FlagRecord)


class Places(NamedTuple):
    """What goes where in the messages."""

    copied: Rows[CopiedRecord]
    flags: Rows[FlagRecord]
    stamps: Words
    """Words of the stamps."""


class Memory(NamedTuple):
    """The messages, one frame after the other: the same memory as integers, floats and bytes."""

    words: Words
    numbers: Vector
    octets: NDArray[np.uint8]


@lean
def write_messages(
    stamp: int, values: Vector, stddev: Vector, places: Places, memory: Memory
) -> bool:
    """Write an estimate into messages; False where a vector is not contiguous.

    Args:
        stamp: [ns], not negative.
        values: of the estimate.
        stddev: its standard deviations, in the order of ``spread_columns``, or shape (0,).
        places: what goes where.
        memory: written.
    """
    if not (is_dense(values) and is_dense(stddev)):
        return False
    second = 1_000_000_000
    for k in range(places.stamps.size):
        memory.words[places.stamps[k]] = stamp // second | (stamp % second) << 32
    for r in range(len(places.copied)):
        row = places.copied[r]
        source = stddev if row.deviation else values
        for k in range(row.count):
            memory.numbers[row.to + k] = source[row.begin + k]
    for r in range(len(places.flags)):
        flag = places.flags[r]
        memory.octets[flag.to] = np.uint8(int(values[flag.one]) | int(values[flag.other]))
    return True


def find_entry() -> Any:
    """Entry point of ``write_messages``, compiled or from the disk."""
    vector, words = np.zeros(0), np.zeros(0, dtype=np.int64)
    copied: Any = np.zeros(0, dtype=COPIED)
    flags: Any = np.zeros(0, dtype=FLAG)
    places, memory = Places(copied, flags, words), _memory_of(words)
    return direct(write_messages, 1, vector, vector, places, memory)


def _memory_of(words: Words) -> Memory:
    return Memory(words, words.view(np.float64), words.view(np.uint8))


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
    """Encodes estimates of one robot as messages, reusing its memory."""

    def __init__(self, layout: Layout, frame_id: str = "", uncertain: bool = False) -> None:
        """Prepare the messages; their names are fixed.

        Args:
            layout: layout of the estimates.
            frame_id: frame of the headers.
            uncertain: whether the messages include standard deviations.
        """
        more = ("stddev",) if uncertain else ()
        axes = layout.motors + layout.joints
        self._layout = layout
        self._axes_begin = len(layout.elements) + len(layout.pulleys)
        """Place of the first effort among the standard deviations."""
        self._width = self._axes_begin + len(axes) if uncertain else 0
        self._no_efforts = Template(JOINT_STATE, axes, (), frame_id)
        self._efforts_stddev = Template(JOINT_STATE, axes, ("effort",), frame_id)
        templates = (
            Template(CABLE_TENSIONS, layout.elements, ("tension", "status", *more), frame_id),
            Template(NODAL_FORCES, layout.pulleys, (*FORCES, "status", *more), frame_id),
            Template(JOINT_STATE, axes, ("effort",), frame_id),
        )
        lengths = [words_of(len(template.payload)) for template in templates]
        begins = [sum(lengths[:k]) for k in range(len(lengths) + 1)]
        self._memory = _memory_of(np.zeros(begins[-1], dtype=np.int64))
        self._payloads = []
        for template, begin, length in zip(templates, begins, lengths, strict=False):
            frame = Frame(len(template.payload), self._memory.words[begin : begin + length])
            frame.payload[:] = template.payload
            self._payloads.append(frame.payload)
        spans = [template.spans for template in templates]
        self._places = Places(
            _copied(layout, spans, begins),
            _flags(layout, spans, begins),
            np.array(begins[:-1], dtype=np.int64) + word_of(ENCAPSULATION),
        )
        self._entry = find_entry()

    def encode(self, estimate: Estimate, stddev: Vector | None = None) -> Encoded:
        """Encode all three messages.

        Args:
            estimate: of this robot.
            stddev: its standard deviations, in the order of ``spread_columns``; None: none known.

        Raises:
            MessageError: an estimate of another robot, standard deviations where none are expected
                or none where they are, or a stamp that no header can hold.
        """
        stamp, values = estimate.stamp_ns, estimate.values
        deviations = NO_STDDEV if stddev is None else stddev
        if values.size != self._layout.size or deviations.size != self._width:
            raise self._mismatch(values, stddev)
        if not 0 <= stamp < END_OF_TIME_NS:
            raise MessageError(f"stamp {stamp} ns does not fit a ROS header")
        if not values.dtype is deviations.dtype is FLOAT:  # which the entry point does not check
            values, deviations = as_plain(values), as_plain(deviations)
        while not self._entry(stamp, values, deviations, self._places, self._memory):
            values, deviations = as_plain(values), as_plain(deviations)
        tensions, forces, efforts = self._payloads
        if not estimate.solved:
            return Encoded(bytes(tensions), bytes(forces), self._no_efforts.encode(stamp))
        return Encoded(bytes(tensions), bytes(forces), bytes(efforts))

    def efforts_stddev(self, estimate: Estimate, stddev: Vector) -> bytes:
        """Encode sensor_msgs/JointState with the standard deviations of the efforts [N m]."""
        if not estimate.solved:
            return self._no_efforts.encode(estimate.stamp_ns)
        return self._efforts_stddev.encode(estimate.stamp_ns, effort=stddev[self._axes_begin :])

    def _mismatch(self, values: Vector, stddev: Vector | None) -> MessageError:
        given = "no" if stddev is None else str(stddev.size)
        return MessageError(
            f"the messages take {self._layout.size} values and {self._width} standard deviations, "
            f"got {values.size} and {given}"
        )


def _copied(layout: Layout, spans: Sequence[Mapping[str, Span]], begins: Sequence[int]) -> Any:
    """Rows of ``CopiedRecord`` for tensions, nodal forces and efforts.

    Args:
        layout: of the estimates.
        spans: of every message.
        begins: first word of every message.
    """
    rows = [(0, "tension", layout.tension.start, 0)]
    rows += [(1, name, getattr(layout, name).start, 0) for name in FORCES]
    rows += [(2, "effort", layout.motor_effort.start, 0)]
    if "stddev" in spans[0]:
        rows += [(0, "stddev", 0, 1), (1, "stddev", len(layout.elements), 1)]
    return np.array(
        [
            (begins[k] + word_of(spans[k][name].offset), begin, spans[k][name].count, deviation)
            for k, name, begin, deviation in rows
        ],
        dtype=COPIED,
    )


def _flags(layout: Layout, spans: Sequence[Mapping[str, Span]], begins: Sequence[int]) -> Any:
    """Rows of ``FlagRecord`` for tensions and nodal forces; arguments as of ``_copied``."""
    begin = layout.status.start
    pairs = [(0, e, e) for e in range(len(layout.elements))]
    pairs += [(1, e, e + 1) for e in layout.element_before.tolist()]
    first = [8 * begins[k] + BEFORE + spans[k]["status"].offset for k in (0, 1)]
    first[1] -= len(layout.elements)
    return np.array(
        [
            (first[k] + place, begin + one, begin + other)
            for place, (k, one, other) in enumerate(pairs)
        ],
        dtype=FLAG,
    )
