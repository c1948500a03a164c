"""Conditioning of one robot's messages: gates that check the readings, then the common time line.

The core does it, `cdrj_ros/core/conditioner.hpp`; see docs/conditioning.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.estimation.reading_limits import axes_of, worth_of
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Robot

Mode = Literal["wait", "predict"]
MODES: Final[tuple[Mode, ...]] = get_args(Mode)
"""How a lagging channel is handled: wait for it, or extrapolate it with its velocity meanwhile."""

Kind = Literal["motors", "joints", "both"]
TOPICS: Final[Mapping[Kind, _core.Topic]] = {
    "motors": _core.Topic.MOTORS,
    "joints": _core.Topic.JOINTS,
    "both": _core.Topic.BOTH,
}
"""What a topic carries."""

HORIZON_NS: Final = 20_000_000
"""A channel is predicted at most this far beyond its last reading [ns]."""


class Conditioner(_core.Conditioner):
    """Gates and time line of one robot: takes messages, returns samples.

    Its counters are ``refused`` (readings by a cause of ``REFUSALS``; for those of ``WHOLE``,
    messages), ``accepted`` and ``elsewhere`` (joints in a message of motors, for example),
    ``clock_jumps`` (the clock went back and conditioning restarted), ``gaps`` (a channel was silent
    for too long), ``steps`` (of sensors: the readings moved further than the axis can, and stayed)
    and ``crowded`` (accepted readings that waited too long for another channel).  ``held`` readings
    wait until it is known whether the clock has jumped, ``unheard`` are the names without an
    accepted reading since the last reset, ``displaced`` has the sum of the steps [rad] of every
    sensor that has stepped since then, ``alternating`` are the names whose readings alternate
    between two motions, ``stuck`` those whose readings repeat while others move on, ``lagging``
    has the lag of axes whose topic is always late, or whose clock differs, and ``lag_ns`` is the
    lag of the last sample behind the newest reading.
    """

    def __init__(self, robot: Robot, mode: Mode = "wait", tracking: float | None = None) -> None:
        """Prepare the channels.

        Args:
            robot: names, sensors and limits; joints without encoder have no channel.
            mode: one of ``MODES``.
            tracking: see ``axes_of``.
        """
        if mode not in MODES:
            raise UsageError(f"mode must be one of {', '.join(MODES)}, got {mode!r}")
        self._robot, self._worth = robot.as_read, worth_of(robot)
        axes = axes_of(self._robot, tracking, self._worth)
        super().__init__(axes, len(robot.motors), mode == "predict", HORIZON_NS)

    def memory(self) -> dict[str, Vector]:
        """Values that outlast a restart, for ``recall``: motion so far and the sensors' steps."""
        axes, stepped = self.remembered()
        return {"axes": axes, "stepped": stepped}

    def recall(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore the values of ``memory`` before the first reading; ignore impossible ones."""
        rows, stepped = arrays["axes"], arrays["stepped"]
        if np.all(np.isfinite(rows)) and np.all(rows[:, :-1] >= 0.0):
            self.remember(rows, stepped)

    def expect(self, angles: Vector, stamp_ns: int) -> None:
        """Continue from the last sample of an earlier run.

        Args:
            angles: of motors, then joints [rad], shape (channels,).
            stamp_ns: of that sample [ns].
        """
        robot = self._robot
        if angles.shape == (len(robot.motors) + len(robot.joints),) and np.isfinite(angles).all():
            self.continue_from(angles, stamp_ns)

    def set_tracking(self, tracking: float | None) -> None:
        """Change the tracking bandwidth, see ``axes_of``; no reading is lost."""
        self.use_tracking_of(axes_of(self._robot, tracking, self._worth))

    def take(
        self,
        kind: Kind,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float] | Vector,
    ) -> list[Sample]:
        """Take a message of angles [rad]; returns the samples that are now complete."""
        return [Sample(*one) for one in self.feed(TOPICS[kind], stamp_ns, names, positions)]
