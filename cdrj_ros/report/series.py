"""Selection of the parts of a long series to draw: gaps in the line, and enlarged windows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.judgement.channels import Channel

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

GAP_STEPS: Final = 5.0
"""A line is broken where two stamps are further apart than this many median steps ..."""

GAP_SHARE: Final = 0.005
"""... and further apart than this share of the drawn time, so that the gap is visible."""

CYCLES: Final = 2
"""Number of motion cycles in a hysteresis loop; more cycles would overlap."""


@dataclass(frozen=True)
class Window:
    """A range of samples of a channel."""

    begin: int
    """First sample."""
    end: int
    """One past the last sample."""
    reversal: int | None
    """Sample of the reversal around which the window was chosen, None if there is none."""


def gaps(stamp_ns: NDArray[np.int64]) -> Indices:
    """Samples after which a line over these stamps must be broken, shape (k,)."""
    if len(stamp_ns) < 3:
        return np.arange(0)
    steps = np.diff(stamp_ns)
    span = float(stamp_ns[-1] - stamp_ns[0])
    return np.flatnonzero(steps > max(GAP_STEPS * float(np.median(steps)), GAP_SHARE * span))


def seconds_since(stamp_ns: NDArray[np.int64], origin_ns: int) -> Floats:
    """Stamps in seconds after an origin, subtracted as integers before conversion to float."""
    return (stamp_ns - origin_ns).astype(np.float64) * 1e-9


def worst_sample(channel: Channel) -> int:
    """The sample with the largest |estimate - reference|; the channel must not be empty."""
    return int(np.argmax(channel.error_size))


def closer_look(channel: Channel, turns: Indices) -> Window:
    """Window around the reversal nearest to the largest error, including both.

    The window extends to either side by a quarter of a motion cycle, or further to include the
    largest error.  If the joint does not reverse near the largest error, the window is centred on
    the error; if it never reverses, the window is a tenth of the recording.

    Args:
        channel: at least one sample.
        turns: its turning points.
    """
    worst = worst_sample(channel)
    stamps = channel.stamp_ns
    if len(turns):
        away = np.abs(stamps[turns] - stamps[worst])
        nearest = int(np.argmin(away))
        half_cycle = _half_cycle_ns(channel, turns)
        if away[nearest] <= half_cycle:
            reach = max(half_cycle // 2, int(away[nearest]) * 5 // 4)
            return _around(channel, int(turns[nearest]), reach, int(turns[nearest]))
        return _around(channel, worst, half_cycle, None)
    return _around(channel, worst, int(stamps[-1] - stamps[0]) // 20, None)


def loop_window(channel: Channel, turns: Indices) -> Window:
    """CYCLES cycles of motion around the closer look; the whole channel if there are fewer."""
    if len(turns) < 2:
        return Window(0, len(channel.stamp_ns), None)
    look = closer_look(channel, turns)
    centre = worst_sample(channel) if look.reversal is None else look.reversal
    return _around(channel, centre, CYCLES * _half_cycle_ns(channel, turns), look.reversal)


def _half_cycle_ns(channel: Channel, turns: Indices) -> int:
    """Median time from one reversal to the next [ns]."""
    stamps = channel.stamp_ns
    if len(turns) < 2:
        return int(stamps[-1] - stamps[0]) // 5
    return int(np.median(np.diff(stamps[turns])))


def _around(channel: Channel, centre: int, reach_ns: int, reversal: int | None) -> Window:
    """A window of ``reach_ns`` to either side of ``centre``, shifted into the recording."""
    stamps = channel.stamp_ns
    first, last = int(stamps[0]), int(stamps[-1])
    begin_ns = max(min(int(stamps[centre]) - reach_ns, last - 2 * reach_ns), first)
    end_ns = min(begin_ns + 2 * reach_ns, last)
    begin = int(np.searchsorted(stamps, begin_ns, side="left"))
    end = int(np.searchsorted(stamps, end_ns, side="right"))
    return Window(begin, max(end, begin + 1), reversal)
