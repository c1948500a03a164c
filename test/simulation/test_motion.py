"""Motions are continuous, stay within their range and return their true derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.simulation import motion

AMPLITUDE, FREQUENCY, BEGIN, CENTRE = 0.6, 0.5, 0.5, 0.1
TIME = np.arange(12_001) / 1000.0


def _replayed() -> motion.Motion:
    times = np.arange(6_000) / 500.0
    counts = 2.0 * np.pi / 16_384
    angle = CENTRE + AMPLITUDE * np.sin(np.pi * times) * np.cos(0.7 * times)
    return motion.recorded(times, np.round(angle / counts) * counts, BEGIN)


MOTIONS = {
    "sine": motion.sine(AMPLITUDE, FREQUENCY, BEGIN, CENTRE),
    "ramps": motion.ramps(AMPLITUDE, FREQUENCY, BEGIN, CENTRE),
    "dwell": motion.dwell(AMPLITUDE, FREQUENCY, BEGIN, CENTRE),
    "random": motion.random(AMPLITUDE, FREQUENCY, 7, BEGIN, CENTRE),
    "recorded": _replayed(),
}
every_motion = pytest.mark.parametrize("name", MOTIONS)


@every_motion
def test_a_motion_stays_within_its_range(name: str) -> None:
    angle = MOTIONS[name](TIME).angle
    assert np.abs(angle - CENTRE).max() <= AMPLITUDE * (1.0 + 1e-9)
    assert np.ptp(angle) > 0.8 * AMPLITUDE, "the motion uses its range"


@every_motion
def test_a_motion_rests_at_its_start_until_it_begins(name: str) -> None:
    course = MOTIONS[name](TIME)
    before = TIME <= BEGIN
    assert np.ptp(course.angle[before]) == 0.0
    assert course.angle[0] == pytest.approx(CENTRE, abs=2e-3)
    assert not course.speed[before].any()


@every_motion
def test_speed_and_acceleration_are_the_derivatives_of_the_angle(name: str) -> None:
    fine = np.arange(120_001) / 10_000.0
    course = MOTIONS[name](fine)
    speed = np.gradient(course.angle, fine)
    assert np.abs(speed - course.speed).max() < 2e-3 * np.abs(course.speed).max()
    acceleration = np.gradient(course.speed, fine)
    error = np.abs(acceleration - course.acceleration)
    jumps = error > 1e-2 * np.abs(course.acceleration).max()
    assert jumps.mean() < 2e-3, "acceleration may jump, but only at corners"


def test_random_motion_has_no_frequency_above_its_band() -> None:
    time = np.arange(200_001) / 1000.0
    angle = motion.random(1.0, FREQUENCY, 11)(time).angle[10_000:]
    power = np.abs(np.fft.rfft(angle * np.hanning(angle.size))) ** 2
    frequency = np.fft.rfftfreq(angle.size, 1e-3)
    assert power[frequency > 1.1 * FREQUENCY].sum() < 1e-6 * power.sum()


def test_a_recorded_motion_is_followed_to_within_its_counts() -> None:
    times = np.arange(6_000) / 500.0
    counts = 2.0 * np.pi / 16_384
    angle = 0.5 * np.sin(2.0 * np.pi * 0.2 * times)
    course = motion.recorded(times, np.round(angle / counts) * counts)(times)
    after = times > 1.0
    expected = np.interp(times[after] - 0.5, times, angle)  # the blend costs half a second
    assert np.abs(course.angle[after] - expected).max() < 2.0 * counts
    bend = np.abs(course.acceleration[after][:-500]).max()
    assert bend == pytest.approx(0.5 * (0.4 * np.pi) ** 2, rel=0.1), "smoothing removes the counts"


def test_a_recording_that_is_too_short_or_disordered_is_refused() -> None:
    for times in (np.arange(5.0), np.array([0.0, 2.0, 1.0] * 10)):
        with pytest.raises(UsageError, match="at least 10 finite angles at increasing times"):
            motion.recorded(times, np.zeros(times.size))
