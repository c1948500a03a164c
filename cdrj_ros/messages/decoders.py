"""Decoding of single messages: joint states, also as fast as they arrive, and tensions."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    ENCAPSULATION,
    JOINT_STATE,
    MessageError,
    Span,
    read_layout,
)

NO_EFFORTS: Final = np.empty(0)
"""What ``KnownJointState.efforts`` finds in a message without efforts."""


@dataclass(frozen=True)
class KnownJointState:
    """A layout prepared for comparison by `JointStateDecoder`."""

    length: int
    """Bytes of the payload."""
    representation: bytes
    head: bytes
    """From the frame's length to the first position."""
    head_stop: int
    tail: tuple[tuple[int, int, bytes], ...]
    """Start, stop and bytes of the lengths after the positions."""
    names: tuple[str, ...]
    stamp: struct.Struct
    dtype: np.dtype[Any]
    stop: int
    effort: Span

    def stamp_ns(self, payload: bytes) -> int:
        """Header stamp of a payload of this layout [ns]."""
        sec, nanosec = self.stamp.unpack_from(payload, 4)
        return int(sec * 1_000_000_000 + nanosec)

    def efforts(self, payload: bytes) -> npt.NDArray[np.float64]:
        """Efforts [N m] in a payload of this layout, shape (n,); n is 0 if it has none."""
        span = self.effort
        if span.count == 0:
            return NO_EFFORTS
        return np.frombuffer(payload, span.dtype, span.count, span.offset).astype(np.float64)


class JointStateDecoder:
    """Callable that decodes the CDR payload of a JointState.

    It returns (stamp_ns, names, position [rad], shape (n,)).  Recent layouts are cached, so a
    message with a known layout takes about a microsecond.  `MessageError` is raised for a payload
    that is not a JointState or has unequal numbers of positions and names.  The position array is
    read-only, aligned and in native byte order.
    """

    KEPT: Final = 8
    """Layouts cached for each payload length; several senders may share a topic."""

    KEPT_BYTES: Final = 4_000_000
    """Total size of the payloads whose layouts are cached [bytes]."""

    def __init__(self, efforts: bool = False) -> None:
        """Start with an empty cache.

        Args:
            efforts: whether efforts are read; messages with efforts for only some of their
                names are then refused.
        """
        self._efforts = efforts
        self.last: KnownJointState | None = None
        """Layout of the payload decoded last."""
        self._known: dict[int, list[KnownJointState]] = {}
        self._bytes = 0

    def __call__(self, payload: bytes) -> tuple[int, tuple[str, ...], npt.NDArray[np.float64]]:
        """Decode one payload."""
        for known in self._known.get(len(payload), ()):
            stop = known.head_stop
            if payload[12:stop] != known.head or payload[:2] != known.representation:
                continue
            for tail_start, tail_stop, tail in known.tail:
                if payload[tail_start:tail_stop] != tail:
                    break
            else:
                self.last = known
                position = np.frombuffer(payload[stop : known.stop], known.dtype)
                if not known.dtype.isnative:
                    position = position.astype(np.float64)
                    position.flags.writeable = False
                return known.stamp_ns(payload), known.names, position
        self._learn(payload)
        return self(payload)

    def _learn(self, payload: bytes) -> None:
        """Cache the layout of a payload that matches no cached one, or raise MessageError."""
        layout = read_layout(payload, JOINT_STATE.fields)
        names, span = layout.texts["name"], layout.numbers["position"]
        if len(names) != span.count:
            raise MessageError(f"{len(names)} names but {span.count} positions")
        effort = layout.numbers["effort"]
        if self._efforts and effort.count not in (0, len(names)):
            raise MessageError(f"{len(names)} names but {effort.count} efforts")
        tail = [(max(a, span.offset), b) for a, b in layout.fixed if b > span.offset]
        known = KnownJointState(
            length=len(payload),
            representation=payload[:2],
            head=payload[12 : span.offset],
            head_stop=span.offset,
            tail=tuple((a, b, payload[a:b]) for a, b in tail),
            names=names,
            stamp=struct.Struct(layout.order + "iI"),
            dtype=np.dtype(span.dtype),
            stop=span.offset + 8 * span.count,
            effort=effort,
        )
        self._bytes += len(payload)
        if len(self._known) >= 64 or self._bytes > self.KEPT_BYTES:
            self._known.clear()
            self._bytes = len(payload)
        family = self._known.setdefault(len(payload), [])
        family.insert(0, known)
        del family[self.KEPT :]


def cable_tensions(
    payload: bytes,
) -> tuple[int, tuple[str, ...], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Decode a CableTensions: (stamp_ns, names, tension [N], stddev [N]), arrays of any length.

    Raises:
        MessageError: not a CableTensions.
    """
    layout = read_layout(payload, CABLE_TENSIONS.fields)
    sec, nanosec = struct.unpack_from(layout.order + "iI", payload, ENCAPSULATION)
    tension, stddev = (
        np.frombuffer(payload, span.dtype, span.count, span.offset).astype(np.float64)
        for span in (layout.numbers["tension"], layout.numbers["stddev"])
    )
    return sec * 1_000_000_000 + nanosec, layout.texts["name"], tension, stddev
