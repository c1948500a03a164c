"""Answers of the estimator on one topic, decoded in bulk."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    FORCE_COMPONENTS,
    JOINT_STATE,
    NODAL_FORCES,
    MessageType,
    read_layout,
)
from cdrj_ros.model.prepared import Layout
from cdrj_ros.replay.heard import Floats

FOLD: Final = 1024
"""Number of messages decoded at once."""


class Kind(NamedTuple):
    """One of the topics on which an estimator answers."""

    topic: str
    message: MessageType
    arrays: tuple[str, ...]
    """Names of the arrays that are compared; the standard deviations are those of the first."""


KINDS: Final = (
    Kind(topics.TENSIONS, CABLE_TENSIONS, ("tension",)),
    Kind(topics.NODAL_FORCES, NODAL_FORCES, ("magnitude", *FORCE_COMPONENTS)),
    Kind(topics.EFFORTS, JOINT_STATE, ("effort",)),
)
FORCES: Final = 1
"""Index of the nodal forces in ``KINDS``."""


def names_of(layout: Layout) -> tuple[tuple[str, ...], ...]:
    """Names in the messages of each kind, in the order of ``KINDS``."""
    return layout.elements, layout.pulleys, layout.motors + layout.joints


@dataclass
class Line:
    """The answers on one topic."""

    kind: Kind
    names: tuple[str, ...]
    place: int = 0
    """Index of the estimate expected next on this topic."""
    count: int = 0
    """Number of estimates received on this topic."""
    given_up: dict[int, int] = field(default_factory=dict)
    """Indices of the estimates given up, by stamp [ns]."""
    index: array[int] = field(default_factory=lambda: array("q"))
    """Indices of the estimates of the messages, in order of arrival."""
    heard_s: array[float] = field(default_factory=lambda: array("d"))
    payloads: list[bytes] = field(default_factory=list)
    """Messages not yet decoded."""
    blocks: list[Floats] = field(default_factory=list)
    """Values of all arrays and the standard deviations, shape (arrays + 1, m, names) each."""

    @property
    def rows(self) -> int:
        """Number of arrays that are kept, with the standard deviations."""
        return len(self.kind.arrays) + 1

    def fold(self) -> None:
        """Decode the stored payloads; a payload with unexpected names becomes NaN."""
        if not self.payloads:
            return
        block = np.full((self.rows, len(self.payloads), len(self.names)), np.nan)
        lengths = np.fromiter(map(len, self.payloads), np.int64, len(self.payloads))
        for length in np.unique(lengths).tolist():
            rows = np.flatnonzero(lengths == length)
            block[:, rows] = self._decode([self.payloads[k] for k in rows])
        self.blocks.append(block)
        self.payloads.clear()

    def _decode(self, payloads: Sequence[bytes]) -> Floats | float:
        """Decode payloads of equal length; NaN if their names differ from the expected ones."""
        layout = read_layout(payloads[0], self.kind.message.fields)
        if layout.texts["name"] != self.names:
            return np.nan
        octets = np.frombuffer(b"".join(payloads), np.uint8).reshape(len(payloads), -1)
        block = np.full((self.rows, len(payloads), len(self.names)), np.nan)
        for row, name in enumerate((*self.kind.arrays, "stddev")):
            span = layout.numbers.get(name)
            if span is not None and span.count == len(self.names):
                wanted = np.ascontiguousarray(octets[:, span.offset : span.offset + 8 * span.count])
                block[row] = wanted.view(span.dtype)
        return block
