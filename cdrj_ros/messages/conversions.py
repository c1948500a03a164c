"""Conversion between messages (as CDR bytes) and the estimator's values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    ENCAPSULATION,
    JOINT_STATE,
    NODAL_FORCES,
)
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.channels import EFFORT, NODAL_FORCE, TENSION
from cdrj_ros.model.prepared import Layout
from cdrj_ros.model.status import STALE

FORCES: Final = ("force_x", "force_y", "force_z", "magnitude", "friction", "slip_speed")
"""Arrays that nodal forces and estimates have by the same names."""

FORCE_ARRAYS: Final = (*FORCES, "status")

PADDING: Final = 7
"""Maximum number of bytes that a middleware may append to a message."""


def marked_stale(estimate: Estimate) -> Estimate:
    """A copy of the estimate with every element marked ``STALE``."""
    values = estimate.values.copy()
    status = values[estimate.layout.status]
    status[:] = status.astype(np.uint8) | STALE
    return replace(estimate, whole=values, part=None)


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
