"""Selects the estimates that are published.  Does not depend on ROS.

The friction state depends on the path of the cable, so every sample is computed: skipping samples
would change the estimates.  Skipping messages does not change the published values by a single bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from cdrj_ros.nodes.parameters import OutputMode
from cdrj_ros.robot.description import Robot

KEPT: Final = 20_000
"""Maximum number of motor stamps stored while waiting for the joints: 20 s at 1 kHz."""


class Thinning:
    """Selects estimates by the stamps of motor readings, by a maximum rate, or by both."""

    def __init__(self, robot: Robot, output: OutputMode, max_rate_hz: float) -> None:
        """Set up the selection.

        Args:
            robot: provides the motors and the clock offsets of their sensors.
            output: ``motor_stamps`` to publish only at stamps of motor readings.
            max_rate_hz: maximum number of estimates per second of the stamps; 0 for no limit.
        """
        self._offset_ns = {motor.name: motor.sensor.clock_offset_ns for motor in robot.motors}
        self._at_motors = output == "motor_stamps"
        self._interval_ns = round(1e9 / max_rate_hz) if max_rate_hz > 0.0 else 0
        self.active = self._at_motors or self._interval_ns > 0
        """Whether any estimate may be skipped."""
        self._stamps: set[int] = set()
        self.reset()

    def reset(self) -> None:
        """Discard the stored stamps; the maximum rate does not limit the next estimate."""
        self._stamps.clear()
        self._last_ns = -1
        self._due_ns = 0

    def note(self, stamp_ns: int, names: Sequence[str]) -> None:
        """Store the stamp of a message; call before ``passes`` for the estimates it leads to."""
        if not self._at_motors:
            return
        self._stamps.update(
            stamp_ns + offset for name, offset in self._offset_ns.items() if name in names
        )
        if len(self._stamps) > KEPT:
            self._stamps = set(sorted(self._stamps)[-KEPT // 2 :])

    def passes(self, stamp_ns: int) -> bool:
        """Whether to publish the estimate of this stamp [ns]; call once for each, in order."""
        if stamp_ns <= self._last_ns:  # the clock jumped back
            self._due_ns = 0
        self._last_ns = stamp_ns
        if self._at_motors:
            at_motor = stamp_ns in self._stamps
            if self._stamps:
                self._stamps = {stamp for stamp in self._stamps if stamp > stamp_ns}
            if not at_motor:
                return False
        if not self._interval_ns:
            return True
        if stamp_ns < self._due_ns:
            return False
        # due times lie on a fixed grid so that jitter does not lower the rate; a gap restarts it
        self._due_ns += self._interval_ns
        if self._due_ns <= stamp_ns:
            self._due_ns = stamp_ns + self._interval_ns
        return True
