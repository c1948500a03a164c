"""Motions are continuous, rest before they begin, and stay within their range and band."""

import numpy as np
import pytest

from cdrj_ros.simulation import motion

AMPLITUDE, FREQUENCY, BEGIN = 0.6, 0.5, 0.5
TIME = np.arange(12_001) / 1000.0


@pytest.mark.parametrize("kind", motion.MOTIONS)
def test_a_motion_rests_until_it_begins_and_uses_its_range_without_jumps(kind):
    angle = motion.named_motion(kind, AMPLITUDE, FREQUENCY, 7)(TIME - BEGIN)
    assert not np.any(angle[TIME <= BEGIN])
    assert np.abs(angle).max() <= AMPLITUDE * (1.0 + 1e-9)
    assert np.ptp(angle) > 0.8 * AMPLITUDE
    speed = np.diff(angle) * 1000.0
    assert np.abs(np.diff(speed)).max() < 0.05 * np.abs(speed).max(), "the speed is continuous"
    resting = np.abs(speed[TIME[:-1] > BEGIN]) < 1e-9
    assert resting.mean() == pytest.approx(0.5 if kind == "dwell" else 0.0, abs=0.01)


def test_random_motion_has_no_frequency_above_its_band():
    time = np.arange(200_001) / 1000.0
    angle = motion.random(1.0, FREQUENCY, 11)(time)[10_000:]
    power = np.abs(np.fft.rfft(angle * np.hanning(angle.size))) ** 2
    frequency = np.fft.rfftfreq(angle.size, 1e-3)
    assert power[frequency > 1.1 * FREQUENCY].sum() < 1e-6 * power.sum()


def test_differences_are_the_derivatives_of_the_angle():
    _, speed, acceleration = motion.differences(TIME, np.sin(3.0 * TIME))
    inside = slice(3, -3)
    np.testing.assert_allclose(speed[inside], 3.0 * np.cos(3.0 * TIME)[inside], atol=1e-4)
    np.testing.assert_allclose(acceleration[inside], -9.0 * np.sin(3.0 * TIME)[inside], atol=1e-4)
