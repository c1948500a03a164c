"""When an element is ``UNSURE``: one rule for the node, sample by sample, and for recordings."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.model.status import INVALID, UNSURE
from cdrj_ros.robot.description import Robot

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

UNSURE_SHARE: Final = 0.1
"""An element is ``UNSURE`` if its standard deviation exceeds this fraction of its tension or of
its cable's preload, whichever is larger."""


def preload_of_elements(robot: Robot) -> Vector:
    """Preload of every element's cable [N], shape (elements,)."""
    return np.repeat(
        [cable.preload for cable in robot.cables],
        [len(cable.element_names) for cable in robot.cables],
    )


def mark_unsure(values: Vector, preload: Vector, stddev: Vector, share: float) -> None:
    """Set ``UNSURE`` where the standard deviation is too large for tension and preload.

    Args:
        values: an estimate (tensions, then status of all elements, then the rest); changed.
        preload: see ``preload_of_elements`` [N].
        stddev: of the tensions, then the rest [N].
        share: see ``UNSURE_SHARE``.
    """
    _core.mark_unsure(values, preload, stddev, share)


def mark_all_unsure(values: Vector, elements: int) -> None:
    """Set ``UNSURE`` on every element of an estimate that is not ``INVALID``."""
    mark_some_unsure(values, np.ones(elements, dtype=np.bool_))


def mark_some_unsure(values: Vector, doubted: NDArray[np.bool_]) -> None:
    """Set ``UNSURE`` on some elements of an estimate, unless they are ``INVALID``.

    Args:
        values: an estimate; changed.
        doubted: which elements, shape (elements,).
    """
    status = values[doubted.size : 2 * doubted.size]
    flags = status.astype(np.int64)
    status[:] = np.where(doubted & (flags & INVALID == 0), flags | UNSURE, flags)


def mark_recording(
    values: Table, preload: Vector, stddev: Table, share: float, doubtful: NDArray[np.bool_]
) -> None:
    """``mark_unsure`` and ``mark_all_unsure`` for all estimates of a recording.

    Args:
        values: estimates, shape (n, size); changed.
        preload: see ``mark_unsure``.
        stddev: shape (n, columns), or (0, 0) where none is known.
        share: see ``mark_unsure``.
        doubtful: see ``Samples.doubtful``, shape (n,) or (0,).
    """
    _core.mark_recording(values, preload, stddev, share, doubtful)
