"""Sensor errors: each defect has the requested size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.robot.description import Sensor
from cdrj_ros.simulation.sensors import (
    Encoder,
    ReadingTimes,
    Sampling,
    Schedule,
    angle_of,
    counted,
)

ENCODER = Encoder(counts=16_384, rate=1000.0)
STEP = 2.0 * np.pi / ENCODER.counts
TIME = np.arange(20_001) / 1000.0
ANGLE = 0.5 * np.sin(TIME)


def _generator() -> np.random.Generator:
    return np.random.default_rng(5)


def _read(encoder: Encoder) -> np.ndarray:
    noise = _generator().normal(0.0, encoder.noise, ANGLE.size)
    return counted(encoder, ANGLE, noise, Sensor())


def schedule(sensor: Sampling, end: float, seed: int = 5) -> Schedule:
    return ReadingTimes(sensor, [seed]).until(end)


def test_every_reading_is_a_whole_number_of_counts() -> None:
    for encoder in (ENCODER, replace(ENCODER, noise=3e-3, bias=0.01)):
        read = _read(encoder)
        counts = read / STEP
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)


def test_noise_and_bias_have_the_requested_size() -> None:
    encoder = replace(ENCODER, noise=2e-3, bias=0.01)
    error = _read(encoder) - ANGLE
    assert error.mean() == pytest.approx(0.01, abs=1e-4)
    assert error.std() == pytest.approx(np.hypot(2e-3, STEP / np.sqrt(12.0)), rel=0.03)


def test_jitter_moves_stamps_and_keeps_their_order() -> None:
    for jitter in (1e-4, 1e-2):
        encoder = replace(ENCODER, jitter=jitter)
        plan = schedule(encoder, 20.0)
        np.testing.assert_array_equal(plan.times, TIME)
        assert np.all(np.diff(plan.stamps) > 0.0)
        off = plan.stamps - plan.times
        assert off.std() == pytest.approx(jitter, rel=0.03) if jitter < 1e-3 else off.std() > 2e-4


def test_the_requested_share_of_readings_is_lost_and_steps_lose_the_same_ones() -> None:
    encoder = replace(ENCODER, jitter=1e-4, dropout=0.1, phase=3e-4)
    plan = schedule(encoder, 100.0)
    assert plan.times.size == pytest.approx(90_000, rel=0.01)
    count = (plan.times - 3e-4) * 1000.0
    np.testing.assert_allclose(count, np.round(count), atol=1e-6)
    stepped = ReadingTimes(encoder, [5])
    parts = [stepped.until(k / 1000.0) for k in range(1001)]
    stamps = np.concatenate([part.stamps for part in parts])
    np.testing.assert_array_equal(stamps, plan.stamps[: stamps.size])
    assert np.any(schedule(encoder, 1.0, 6).stamps[:500] != stamps[:500])


def test_a_reading_with_a_period_starts_again_and_stays_within_it() -> None:
    sensor = Sensor(period=1.0)
    angle = 2.0 * TIME / TIME[-1]
    read = counted(ENCODER, angle, 0.0, sensor)
    assert np.abs(read).max() <= 0.5 + STEP
    assert np.count_nonzero(np.abs(np.diff(read)) > 0.5) == 2
    assert np.abs(np.unwrap(read, period=1.0) - angle).max() <= 0.5 * STEP + 1e-12


def test_the_robot_file_converts_a_reading_back_into_the_angle() -> None:
    bent = Sensor(-0.5, 0.3, corrected_at=(-0.4, 0.0, 0.3), correction=(0.1, -0.1, 0.02))
    for sensor in (Sensor(scale=-0.5, offset=0.3), bent):
        read = counted(ENCODER, ANGLE, 0.0, sensor)
        steepest = 1.4 if sensor is bent else 1.0
        assert np.abs(angle_of(sensor, read) - ANGLE).max() <= steepest * 0.5 * STEP + 1e-12
