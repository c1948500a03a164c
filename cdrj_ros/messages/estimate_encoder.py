"""Encoding of estimates as messages, all three of a sample at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Estimate
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
from cdrj_ros.model.prepared import Layout

Vector = NDArray[np.float64]
Places = NDArray[np.intp]

END_OF_TIME_NS: Final = 2**31 * 1_000_000_000
"""The stamp of a header, whose seconds have 32 bits with a sign, is below this [ns]."""


class Copied(NamedTuple):
    """Numbers that are copied into the messages from an estimate or its standard deviations."""

    to: Places
    """Words in the messages."""
    source: Places
    """Places among the estimate's values, or among the standard deviations."""


class Flags(NamedTuple):
    """Status in the messages: the union of the flags of two elements, which may be the same."""

    to: Places
    """Bytes in the messages."""
    one: Places
    """Places of the elements' status among the estimate's values."""
    other: Places


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
        self._words = np.zeros(begins[-1], dtype=np.int64)
        """The messages, one frame after the other; the same memory as integers, floats and bytes"""
        self._numbers, self._bytes = self._words.view(np.float64), self._words.view(np.uint8)
        self._payloads = []
        for template, begin, length in zip(templates, begins, lengths, strict=False):
            frame = Frame(len(template.payload), self._words[begin : begin + length])
            frame.payload[:] = template.payload
            self._payloads.append(frame.payload)
        spans = [template.spans for template in templates]
        self._values, self._stddevs = _copied(layout, spans, begins)
        self._flags = _flags(layout, spans, begins)
        self._stamps = np.array(begins[:-1], dtype=np.intp) + word_of(ENCAPSULATION)

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
        if (
            values.size != self._layout.size
            or (stddev.size if stddev is not None else 0) != self._width
        ):
            raise self._mismatch(values, stddev)
        if not 0 <= stamp < END_OF_TIME_NS:
            raise MessageError(f"stamp {stamp} ns does not fit a ROS header")
        second, nanosecond = divmod(stamp, 1_000_000_000)
        self._words[self._stamps] = second | nanosecond << 32
        self._numbers[self._values.to] = values[self._values.source]
        if stddev is not None:
            self._numbers[self._stddevs.to] = stddev[self._stddevs.source]
        one, other = values[self._flags.one], values[self._flags.other]
        self._bytes[self._flags.to] = one.astype(np.uint8) | other.astype(np.uint8)
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


def _copied(
    layout: Layout, spans: Sequence[Mapping[str, Span]], begins: Sequence[int]
) -> tuple[Copied, Copied]:
    """What is copied from the estimate's values, and from its standard deviations.

    Args:
        layout: of the estimates.
        spans: of every message.
        begins: first word of every message.
    """
    values = [(0, "tension", layout.tension.start)]
    values += [(1, name, getattr(layout, name).start) for name in FORCES]
    values += [(2, "effort", layout.motor_effort.start)]
    stddevs = (
        [(0, "stddev", 0), (1, "stddev", len(layout.elements))] if "stddev" in spans[0] else []
    )

    def places(parts: Sequence[tuple[int, str, int]]) -> Copied:
        to, source = np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
        for message, name, begin in parts:
            span = spans[message][name]
            numbers = np.arange(span.count)
            to = np.append(to, begins[message] + word_of(span.offset) + numbers)
            source = np.append(source, begin + numbers)
        return Copied(to, source)

    return places(values), places(stddevs)


def _flags(layout: Layout, spans: Sequence[Mapping[str, Span]], begins: Sequence[int]) -> Flags:
    """The status of elements and pulleys; arguments as of ``_copied``."""
    elements, before = np.arange(len(layout.elements)), layout.element_before
    first = [8 * begins[k] + BEFORE + spans[k]["status"].offset for k in (0, 1)]
    to = np.concatenate([first[0] + elements, first[1] + np.arange(before.size)])
    one = layout.status.start + np.concatenate([elements, before])
    other = layout.status.start + np.concatenate([elements, before + 1])
    return Flags(to, one, other)
