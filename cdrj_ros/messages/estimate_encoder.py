"""Encoding of estimates as messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros._core import END_OF_TIME_NS, MessageEncoder
from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    JOINT_STATE,
    NODAL_FORCES,
    MessageError,
    MessageType,
)
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import Layout
from cdrj_ros.model.status import STALE

FORCES: Final = ("force_x", "force_y", "force_z", "magnitude", "friction", "slip_speed")
"""Arrays that nodal forces and estimates have by the same names."""

NONE_KNOWN: Final = np.empty(0)
"""Standard deviations for messages without them."""


def marked_stale(estimate: Estimate) -> Estimate:
    """A copy of the estimate with every element marked ``STALE``."""
    values = estimate.values.copy()
    status = values[estimate.layout.status]
    status[:] = status.astype(np.uint8) | STALE
    return replace(estimate, whole=values, part=None)


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
        elements, pulleys = len(layout.elements), len(layout.pulleys)
        axes = layout.motors + layout.joints
        self._width = elements + pulleys + len(axes) if uncertain else 0
        of_elements = [(k, k) for k in range(elements)]
        of_pulleys = [(int(k), int(k) + 1) for k in layout.element_before]
        begins = (0, elements, elements + pulleys) if uncertain else (None, None, None)
        prepare = _Preparation(layout)
        self._tensions = prepare.message(
            CABLE_TENSIONS, layout.elements, ("tension",), begins[0], beside=of_elements
        )
        self._nodal_forces = prepare.message(
            NODAL_FORCES, layout.pulleys, FORCES, begins[1], beside=of_pulleys
        )
        self._efforts = prepare.message(JOINT_STATE, axes, ("effort",))
        self._no_efforts = prepare.message(JOINT_STATE, axes)
        self._efforts_stddev = prepare.message(JOINT_STATE, axes, (), begins[2], "effort")

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


@dataclass(frozen=True)
class _Preparation:
    """Prepares the messages of one robot."""

    layout: Layout

    def message(
        self,
        message: MessageType,
        names: tuple[str, ...],
        values: Sequence[str] = (),
        first_stddev: int | None = None,
        stddev: str = "stddev",
        beside: Sequence[tuple[int, int]] = (),
    ) -> MessageEncoder:
        """Prepare a message.

        Args:
            message: its type.
            names: its names.
            values: its arrays that are copied from the estimate.
            first_stddev: index of its first standard deviation; None: it has none.
            stddev: its array that holds the standard deviations.
            beside: for a message with status, the elements beside each of its names.
        """
        uncertain = first_stddev is not None
        arrays = (*values, *(("status",) if beside else ()), *((stddev,) if uncertain else ()))
        frame = self.layout.force_frame if message is NODAL_FORCES else self.layout.base_link
        blank = Template(message, names, arrays, frame)
        at = {array: span.offset for array, span in blank.spans.items()}
        status = self.layout.status.start
        return MessageEncoder(
            blank.payload,
            values=[(at[one], self._first(one), len(names)) for one in values],
            stddevs=[(at[stddev], first_stddev, len(names))] if first_stddev is not None else [],
            flags=[
                (at["status"] + k, status + before, status + after)
                for k, (before, after) in enumerate(beside)
            ],
        )

    def _first(self, array: str) -> int:
        """Index of the first number of a message's array among the estimate's values."""
        part = self.layout.motor_effort if array == "effort" else getattr(self.layout, array)
        return int(part.start)
