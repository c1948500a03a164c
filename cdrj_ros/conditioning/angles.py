"""Angle of a sensor's reading."""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.robot.description import Sensor


@overload
def angle_of(sensor: Sensor, reading: float) -> float: ...
@overload
def angle_of(sensor: Sensor, reading: NDArray[np.float64]) -> NDArray[np.float64]: ...
def angle_of(sensor: Sensor, reading: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """Angle: scale * reading + offset, and the correction at that angle.

    The estimator uses these angles, so everything that shows a pose does.

    Args:
        sensor: its ``scale``, ``offset`` and ``correction`` are used.
        reading: one or many, with the whole periods that it has wrapped around [rad] or [m].

    Returns:
        As many angles [rad] or [m].
    """
    angle = reading
    if sensor.scale != 1.0 or sensor.offset != 0.0:
        angle = sensor.scale * angle + sensor.offset
    if sensor.corrected_at:
        angle = angle + np.interp(angle, sensor.corrected_at, sensor.correction)
    return angle
