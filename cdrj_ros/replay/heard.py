"""Answers of one run of the estimator, and their counters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.channels import channel_columns
from cdrj_ros.model.prepared import Layout

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]


def channels_of(layout: Layout) -> list[str]:
    """The compared channels, in the order of the columns of ``Heard.value``."""
    return list(channel_columns(layout))


@dataclass(frozen=True)
class Tally:
    """Counters so far."""

    sent: int = 0
    """Published inputs."""
    expected: int = 0
    """Estimates that result from the inputs sent."""
    received: int = 0
    """Estimates of which all three messages have been received."""
    lost: int = 0
    """Expected estimates that were given up or skipped by a later one."""
    late: int = 0
    """Estimates received after they were counted as lost; they no longer count as lost."""
    strange: int = 0
    """Answers that belong to no input: from another estimator or an earlier run."""

    @property
    def under_way(self) -> int:
        """Estimates in flight, neither received nor lost yet."""
        return self.expected - self.received - self.lost

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.sent + other.sent,
            self.expected + other.expected,
            self.received + other.received,
            self.lost + other.lost,
            self.late + other.late,
            self.strange + other.strange,
        )


@dataclass(frozen=True, eq=False)
class Heard:
    """All answers of one run of the estimator, that is between two resets."""

    tally: Tally
    stamp_ns: Stamps
    """Stamps of the complete answers in the order expected [ns], shape (n,)."""
    value: Floats
    """Estimates of ``channels_of`` the robot, shape (n, channels)."""
    force: Floats
    """Components x, y and z of the nodal forces [N], shape (n, 3, pulleys)."""
    latency_s: Floats
    """Time from sending the last input needed to receiving the last of three messages [s],
    shape (n,)."""
    stddev: Floats
    """Standard deviation of ``value``; NaN where the estimator gives none."""
    angle: Floats
    """Motor and joint positions of the samples [rad or m], shape (n, motors + joints)."""
    accepted: int
    """Number of readings that the conditioner accepted."""
    refused: dict[str, int]
    """Number of readings that the conditioner refused, by cause."""
    clock_jumps: int
    """Number of backward jumps of the recording's clock."""
    gaps: int
    """Number of long gaps in a channel."""
    steps: int = 0
    """Number of steps of a channel's readings that exceed the axis' possible motion."""
