"""Readings that are too sparse for the motion, in words: the rate, what it costs, the remedy."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Final

import numpy as np

from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.output import printable
from cdrj_ros.robot.description import Robot

NOTED: Final = 0.01
"""Share of a preload that motions between two readings may be worth without a word."""


def sparse_words(
    robot: Robot, worth: Sequence[float], midway: Vector, rate_hz: float, noted: float = NOTED
) -> str:
    """Axes whose motion between two readings is unknown, and the rate that would show it.

    What a smooth motion leaves unknown midway is as the square of the time between two readings.

    Args:
        robot: names the axes.
        worth: by axis, see ``conditioner.worth_of``.
        midway: standard deviations midway between two samples [rad], shape (axes,).
        rate_hz: rate of the samples [Hz], positive.
        noted: share of a preload from which an axis is named.

    Returns:
        A sentence without full stop; empty if there is no such axis.
    """
    shares = {
        printable(axis.name): UNSURE_SHARE * float(unknown) / own
        for axis, unknown, own in zip(robot.as_read.axes, midway, worth, strict=True)
        if own > 0.0 and UNSURE_SHARE * unknown > noted * own
    }
    if not shares:
        return ""
    most = max(shares.values())
    what = f"{', '.join(shares)} read at {rate_hz:.3g} Hz: too sparse for this motion"
    if not np.isfinite(most):
        return what
    enough = ceil(rate_hz * np.sqrt(most / NOTED))
    return f"{what}, which between two readings is worth {most:.0%} of a preload; {enough} Hz do"
