"""Detection of reversals of a motion and of clock resets."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.evaluation.reversals import (
    AROUND_NS,
    REVERSAL_SHARE,
    reversal_zones,
    within,
)

STEP_NS = 1_000_000


def swing(periods: float, frequency: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    time = np.arange(int(periods / frequency / 1e-3)) * 1e-3
    stamps = 1_722_000_000_000_000_000 + np.arange(len(time), dtype=np.int64) * STEP_NS
    return stamps, np.sin(2 * np.pi * frequency * time)


def test_a_zone_lasts_for_a_fixed_share_of_the_stroke() -> None:
    stamps, angle = swing(3.0)
    zones = reversal_zones(stamps, [angle])
    assert zones.shape == (6, 2)
    quarter = 0.5e9
    taken_up = np.arccos(1.0 - 2.0 * REVERSAL_SHARE) / (2 * np.pi * 0.5) * 1e9
    for k, (begin, end) in enumerate(zones[:-1]):
        turn = float(stamps[0]) + quarter + k * 2 * quarter
        assert begin == pytest.approx(turn - AROUND_NS, abs=2 * STEP_NS)
        assert end == pytest.approx(turn + taken_up, abs=2 * STEP_NS)


def test_overlapping_zones_of_motors_and_joints_are_merged() -> None:
    stamps, angle = swing(3.0)
    late = np.roll(angle, 150)
    both = reversal_zones(stamps, [angle, late])
    alone = reversal_zones(stamps, [angle])
    assert len(both) == len(alone)
    assert np.all(np.diff(both.ravel()) > 0)
    inside = within(both, stamps)
    assert np.all(inside[within(alone, stamps)])
    assert inside.sum() > within(alone, stamps).sum()


@pytest.mark.parametrize("angle", [np.zeros(500), np.linspace(0.0, 1.0, 500), np.zeros(1)])
def test_a_motion_without_reversal_has_no_zone(angle: np.ndarray) -> None:
    stamps = np.arange(len(angle), dtype=np.int64) * STEP_NS
    zones = reversal_zones(stamps, [angle])
    assert zones.shape == (0, 2)
    assert not within(zones, stamps).any()
