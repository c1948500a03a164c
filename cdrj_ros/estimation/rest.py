"""Check that a robot is at rest: a tare in motion would make every tension wrong."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from cdrj_ros.conditioning.limits import half_width
from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.robot.description import Robot

REST_NS: Final = 300_000_000
"""Time for which every axis must have stood still before a tare [ns]."""

REST_STEP_NS: Final = 10_000_000
"""Minimum interval between the samples that are checked [ns]."""

REST_FLOOR: Final = 1e-3
"""Movement allowed at rest for an axis whose sensor has neither resolution nor noise [rad]."""


class RestWatch:
    """Keeps the samples of the last ``REST_NS``."""

    def __init__(self) -> None:
        """Begin with no samples."""
        self._samples: deque[Sample] = deque()
        """At most one sample per ``REST_STEP_NS``."""
        self._last: Sample | None = None

    def add(self, sample: Sample) -> None:
        """Take the next sample."""
        self._last = sample
        kept = self._samples
        if not kept or sample.stamp_ns - kept[-1].stamp_ns >= REST_STEP_NS:
            kept.append(sample)
            while len(kept) > 2 and sample.stamp_ns - kept[1].stamp_ns >= REST_NS:
                kept.popleft()

    def in_motion(self, robot: Robot) -> str:
        """Why the robot is not considered at rest: the axis, its movement and the allowed movement.

        Empty if every axis has stayed within its sensor's errors for ``REST_NS``.
        """
        samples = [*self._samples, *([self._last] if self._last else [])]
        watched = samples[-1].stamp_ns - samples[0].stamp_ns if samples else 0
        if watched < REST_NS:
            return (
                f"the axes must be at rest for {REST_NS * 1e-9:g} s; so far there are "
                f"readings of {watched * 1e-9:.3g} s"
            )
        angles = np.array([np.concatenate([one.motor_angle, one.joint_angle]) for one in samples])
        for axis, moved in zip(robot.axes, np.ptp(angles, axis=0), strict=True):
            allowed = 4.0 * half_width(axis.sensor) or REST_FLOOR
            if moved > allowed:
                return (
                    f"not at rest: {axis.name} moved by {moved:.3g} rad within the last "
                    f"{watched * 1e-9:.2g} s, where {allowed:.3g} rad is allowed"
                )
        return ""
