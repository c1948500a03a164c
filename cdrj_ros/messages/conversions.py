"""Conversion between messages (as CDR bytes) and the estimator's values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import EVERYTHING, Estimate
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    ENCAPSULATION,
    JOINT_STATE,
    NODAL_FORCES,
    MessageError,
)
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.channels import EFFORT, NODAL_FORCE, TENSION
from cdrj_ros.model.prepared import Layout
from cdrj_ros.model.status import STALE

FORCE_ARRAYS: Final = (
    "force_x",
    "force_y",
    "force_z",
    "magnitude",
    "friction",
    "slip_speed",
    "status",
)


FORCES: Final = ("force_x", "force_y", "force_z", "magnitude", "friction", "slip_speed")
"""Of these, the arrays that an estimate has too, by the same names."""

PADDING: Final = 7
"""Maximum number of bytes that a middleware may append to a message."""


class EstimateEncoder:
    """Encodes estimates of one robot as messages, reusing its buffers."""

    def __init__(self, layout: Layout, frame_id: str = "", uncertain: bool = False) -> None:
        """Prepare the messages; their names are fixed.

        Args:
            layout: layout of the estimates.
            frame_id: frame of the headers.
            uncertain: whether the messages include standard deviations.
        """
        self._layout = layout
        more = ("stddev",) if uncertain else ()
        self._uncertain = uncertain
        self._tensions = Template(
            CABLE_TENSIONS, layout.elements, ("tension", "status", *more), frame_id
        )
        self._forces = Template(NODAL_FORCES, layout.pulleys, (*FORCE_ARRAYS, *more), frame_id)
        self._elements, self._pulleys = len(layout.elements), len(layout.pulleys)
        axes = layout.motors + layout.joints
        self._efforts = Template(JOINT_STATE, axes, ("effort",), frame_id)
        self._no_efforts = Template(JOINT_STATE, axes, (), frame_id)
        self._efforts_stddev = Template(JOINT_STATE, axes, ("effort",), frame_id)
        self._in_tensions = self._places(self._tensions, ("tension",))
        self._in_forces = self._places(self._forces, FORCES)
        first = self._elements
        self._stddev_of_tensions = slice(0, first)
        self._stddev_of_forces = slice(first, first + self._pulleys)
        self._status = b""
        """Of all elements in the messages as they are, as bytes of the estimate."""

    def _places(
        self, template: Template, names: Sequence[str]
    ) -> list[tuple[NDArray[np.float64], slice]]:
        """Arrays of a message, and where their values stand in an estimate."""
        return [(template.views[name], getattr(self._layout, name)) for name in names]

    def _patch(
        self,
        template: Template,
        places: list[tuple[NDArray[np.float64], slice]],
        estimate: Estimate,
        stddev: NDArray[np.float64] | None,
        part: slice,
    ) -> bytes:
        """Encode a message of some of the estimate's arrays and a part of ``stddev``."""
        if self._uncertain != (stddev is not None):
            raise MessageError(
                f"the encoder is for messages {'with' if self._uncertain else 'without'} stddev"
            )
        values = estimate.values
        for view, where in places:
            view[...] = values[where]  # half the time of copyto
        if stddev is not None:
            template.views["stddev"][...] = stddev[part]
        status = values[self._layout.status]
        packed = status.tobytes()
        if packed != self._status:  # rarely: a comparison takes a tenth of the conversion
            flags = status.astype(np.uint8)
            self._tensions.views["status"][:] = flags
            self._forces.views["status"][:] = self._layout.pulley_status(flags)
            self._status = packed
        return template.stamped(estimate.stamp_ns)

    def tensions(self, estimate: Estimate, stddev: NDArray[np.float64] | None = None) -> bytes:
        """Encode cdrj_msgs/CableTensions; ``stddev`` is in the order of ``spread_columns``."""
        return self._patch(
            self._tensions, self._in_tensions, estimate, stddev, self._stddev_of_tensions
        )

    def nodal_forces(self, estimate: Estimate, stddev: NDArray[np.float64] | None = None) -> bytes:
        """Encode cdrj_msgs/NodalForces; a pulley has the flags of both adjacent elements."""
        return self._patch(self._forces, self._in_forces, estimate, stddev, self._stddev_of_forces)

    def efforts(self, estimate: Estimate) -> bytes:
        """Encode sensor_msgs/JointState with the efforts of all motors, then all joints [N m].

        The efforts are empty if any element is ``INVALID``, because the message has no status.
        """
        layout = self._layout
        if not estimate.solved:
            return self._no_efforts.encode(estimate.stamp_ns)
        return self._efforts.encode(
            estimate.stamp_ns,
            effort=estimate.values[layout.motor_effort.start : layout.joint_effort.stop],
        )

    def efforts_stddev(self, estimate: Estimate, stddev: NDArray[np.float64]) -> bytes:
        """Encode sensor_msgs/JointState with the standard deviations of ``efforts`` [N m]."""
        if not estimate.solved:
            return self._no_efforts.encode(estimate.stamp_ns)
        return self._efforts_stddev.encode(
            estimate.stamp_ns, effort=stddev[self._elements + self._pulleys :]
        )


def marked_stale(estimate: Estimate) -> Estimate:
    """A copy of the estimate with every element marked ``STALE``."""
    values = estimate.values.copy()
    status = values[estimate.layout.status]
    status[:] = status.astype(np.uint8) | STALE
    return estimate._replace(whole=values, place=EVERYTHING)


class AnswerReader:
    """Decodes messages that ``EstimateEncoder`` wrote for a robot of this layout."""

    def __init__(self, layout: Layout) -> None:
        """Prepare the locations of the arrays."""
        self.layout = layout
        tensions, forces = ("tension", "status"), FORCE_ARRAYS
        self._templates = {
            TENSION: [
                Template(CABLE_TENSIONS, layout.elements, (*tensions, "stddev")),
                Template(CABLE_TENSIONS, layout.elements, tensions),
            ],
            NODAL_FORCE: [
                Template(NODAL_FORCES, layout.pulleys, (*forces, "stddev")),
                Template(NODAL_FORCES, layout.pulleys, forces),
            ],
            EFFORT: [Template(JOINT_STATE, layout.motors + layout.joints, ("effort",))],
        }

    def stamp(self, payload: bytes) -> int:
        """Header stamp [ns]."""
        sec = int.from_bytes(payload[4:8], "little", signed=True)
        return sec * 1_000_000_000 + int.from_bytes(payload[8:12], "little")

    def arrays(
        self, kind: str, payloads: Sequence[bytes]
    ) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]:
        """Stamps [ns], shape (n,), and arrays, shape (n, names), of messages of one kind.

        The arrays include ``stddev`` if the first message has it.  Messages of another length, for
        instance of another robot, are skipped.
        """
        template = self._templates[kind][-1]
        for candidate in self._templates[kind]:
            if payloads and 0 <= len(payloads[0]) - len(candidate.payload) <= PADDING:
                template = candidate
                break
        size = len(template.payload)
        alike = [payload[:size] for payload in payloads if 0 <= len(payload) - size <= PADDING]
        rows = np.frombuffer(b"".join(alike), np.uint8).reshape(len(alike), size)
        stamps = rows[:, ENCAPSULATION : ENCAPSULATION + 8].copy()
        sec = stamps.view("<i4")[:, 0].astype(np.int64)
        nanosec = stamps.view("<u4")[:, 1].astype(np.int64)
        arrays = {
            name: np.ascontiguousarray(
                rows[:, span.offset : span.offset + span.count * np.dtype(span.dtype).itemsize]
            )
            .view(span.dtype)
            .astype(np.float64)
            for name, span in template.spans.items()
        }
        return sec * 1_000_000_000 + nanosec, arrays
