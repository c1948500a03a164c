"""Motions are continuous, rest before they begin, and stay within their range and band."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.simulation import motion

AMPLITUDE, FREQUENCY, BEGIN, CENTRE = 0.6, 0.5, 0.5, 0.1
TIME = np.arange(12_001) / 1000.0


@pytest.mark.parametrize("kind", motion.MOTIONS)
def test_a_motion_rests_until_it_begins_and_uses_its_range_without_jumps(
    kind: motion.MotionKind,
) -> None:
    angle = motion.named_motion(kind, AMPLITUDE, FREQUENCY, 7, BEGIN, CENTRE)(TIME)
    assert not np.any(angle[TIME <= BEGIN] - CENTRE)
    assert np.abs(angle - CENTRE).max() <= AMPLITUDE * (1.0 + 1e-9)
    assert np.ptp(angle) > 0.8 * AMPLITUDE
    speed = np.diff(angle) * 1000.0
    assert np.abs(np.diff(speed)).max() < 0.05 * np.abs(speed).max(), "the speed is continuous"
    resting = np.abs(speed[TIME[:-1] > BEGIN]) < 1e-9
    assert resting.mean() == pytest.approx(0.5 if kind == "dwell" else 0.0, abs=0.01)


def test_random_motion_has_no_frequency_above_its_band() -> None:
    time = np.arange(200_001) / 1000.0
    angle = motion.random(1.0, FREQUENCY, 11)(time)[10_000:]
    power = np.abs(np.fft.rfft(angle * np.hanning(angle.size))) ** 2
    frequency = np.fft.rfftfreq(angle.size, 1e-3)
    assert power[frequency > 1.1 * FREQUENCY].sum() < 1e-6 * power.sum()


def test_differences_are_the_derivatives_of_the_angle() -> None:
    course = motion.differences(TIME, np.sin(3.0 * TIME))
    inside = slice(3, -3)
    np.testing.assert_allclose(course.speed[inside], 3.0 * np.cos(3.0 * TIME)[inside], atol=1e-4)
    np.testing.assert_allclose(
        course.acceleration[inside], -9.0 * np.sin(3.0 * TIME)[inside], atol=1e-4
    )


def test_a_recorded_motion_is_followed_to_within_its_counts_and_without_their_accelerations() -> (
    None
):
    times = np.arange(6_000) / 500.0
    counts = 2.0 * np.pi / 16_384
    angle = 0.5 * np.sin(2.0 * np.pi * 0.2 * times)
    course = motion.differences(
        times, motion.recorded(times, np.round(angle / counts) * counts)(times)
    )
    after = times > 1.0
    expected = np.interp(times[after] - 0.5, times, angle)  # the slow start costs half a second
    assert np.abs(course.angle[after] - expected).max() < 2.0 * counts
    assert abs(course.speed[0]) < 1e-3
    bend = np.abs(course.acceleration[after][:-500]).max()
    assert bend == pytest.approx(0.5 * (0.4 * np.pi) ** 2, rel=0.1), "smoothing removes the counts"
    assert motion.recorded_duration(times) == times[-1] + 0.5
    for wrong in (np.arange(5.0), np.array([0.0, 2.0, 1.0] * 10)):
        with pytest.raises(UsageError, match="at least 10 finite angles at increasing times"):
            motion.recorded(wrong, np.zeros(wrong.size))
