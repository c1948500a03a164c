"""Decoding of single messages of tensions; the core decodes joint states."""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

from cdrj_ros.messages.cdr import CABLE_TENSIONS, ENCAPSULATION, read_layout


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
