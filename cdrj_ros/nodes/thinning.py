"""Which estimates are published; every sample is computed in any case.  No ROS here.

Friction remembers the way that a cable has gone, so leaving out samples would change the numbers.
Leaving out messages does not: what is published is bit for bit what would be published without.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from cdrj_ros.nodes.parameters import OutputMode
from cdrj_ros.robot.description import Robot

KEPT: Final = 20_000
"""Stamps of motors that are remembered while the joints are waited for: 20 s at 1 kHz."""


class Thinning:
    """Chooses estimates by the stamps of motors, by a maximum rate, or both."""

    def __init__(self, robot: Robot, output: OutputMode, max_rate_hz: float) -> None:
        """Prepare.

        Args:
            robot: its motors, and the clock offsets of their sensors.
            output: ``motor_stamps`` to publish only at stamps of motor readings.
            max_rate_hz: estimates per second of the stamps; 0 for no limit.
        """
        self._offset_ns = {motor.name: motor.sensor.clock_offset_ns for motor in robot.motors}
        self._at_motors = output == "motor_stamps"
        self._interval_ns = round(1e9 / max_rate_hz) if max_rate_hz > 0.0 else 0
        self.active = self._at_motors or self._interval_ns > 0
        """Whether anything is left out."""
        self._stamps: set[int] = set()
        self.reset()

    def reset(self) -> None:
        """Start anew; the next estimate is published."""
        self._stamps.clear()
        self._last_ns = -1
        self._due_ns = 0

    def note(self, stamp_ns: int, names: Sequence[str]) -> None:
        """Take the stamp and the names of a message, before its estimates are asked about."""
        if not self._at_motors:
            return
        self._stamps.update(
            stamp_ns + offset for name, offset in self._offset_ns.items() if name in names
        )
        if len(self._stamps) > KEPT:
            self._stamps = set(sorted(self._stamps)[-KEPT // 2 :])

    def passes(self, stamp_ns: int) -> bool:
        """Whether the estimate of this stamp [ns] is published; ask once for each, in order."""
        if stamp_ns <= self._last_ns:  # the clock has gone back
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
        # on a grid of intervals, so that jitter does not lower the rate; a new grid after a gap
        self._due_ns += self._interval_ns
        if self._due_ns <= stamp_ns:
            self._due_ns = stamp_ns + self._interval_ns
        return True
