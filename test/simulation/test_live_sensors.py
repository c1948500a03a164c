"""Sensors of the live rig give the same readings as those of a whole recording."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace as Robots

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.robot.description import Sensor
from cdrj_ros.simulation.live_sensors import LiveCells, LiveEncoders, Reading
from cdrj_ros.simulation.sensors import (
    JOINT_ENCODER,
    Encoder,
    LoadCells,
    read_encoder,
    reading_times,
)

TIME = np.arange(4_001) / 1000.0
ANGLE = np.stack([np.sin(3.0 * TIME), 0.3 * TIME], axis=1)


def fed(sensor: LiveEncoders | LiveCells, values: np.ndarray = ANGLE) -> list[Reading]:
    return [
        reading
        for time, row in zip(TIME.tolist(), values, strict=True)
        for reading in sensor.take(time, row)
    ]


def test_encoders_give_the_counts_of_a_whole_recording(robots: Robots) -> None:
    motors = list(robots.finger().motors)
    motors[1] = replace(motors[1], sensor=Sensor(scale=-0.5, offset=0.3, period=1.0))
    encoder = Encoder(4096, 300.0, 0.0004, bias=0.01)
    readings = fed(LiveEncoders(encoder, motors, [1]))
    times = reading_times(0.0, TIME[-1], encoder.rate, encoder.phase_s)
    np.testing.assert_allclose([one.stamp_s for one in readings], times, atol=1e-12)
    found = np.array([one.values for one in readings])
    for a, axis in enumerate(motors):
        wanted = read_encoder(encoder, times, TIME, ANGLE[:, a], None, axis.sensor)
        same = found[:, a] == wanted
        assert same.mean() > 0.999, "except where rounding decides between two counts"


def test_a_reading_arrives_after_its_latency_with_its_own_stamp(robots: Robots) -> None:
    motors = robots.finger().motors
    prompt, late = (LiveEncoders(JOINT_ENCODER, motors, [1], by) for by in (0.0, 0.0123))
    soon, after = fed(prompt), fed(late)
    assert len(soon) - len(after) == 6
    for one, other in zip(soon, after, strict=False):
        assert one.stamp_s == other.stamp_s
        np.testing.assert_array_equal(one.values, other.values)
    waiting = LiveEncoders(JOINT_ENCODER, motors, [1], 0.0123)
    arrived = [len(waiting.take(time, ANGLE[k])) for k, time in enumerate(TIME[:30].tolist())]
    assert arrived.index(1) == 13, "0.3 ms of phase and 12.3 ms of latency"


def test_noise_jitter_and_losses_have_the_requested_size(robots: Robots) -> None:
    encoder = Encoder(2**22, 1000.0, noise=1e-3, jitter_s=1e-4, dropout=0.1, burst_s=0.005)
    readings = fed(LiveEncoders(encoder, robots.finger().motors, [3]), np.zeros_like(ANGLE))
    assert 0.8 < len(readings) / TIME.size < 0.97
    assert np.std([one.values for one in readings]) == pytest.approx(1e-3, rel=0.05)
    stamps = np.array([one.stamp_s for one in readings])
    off = stamps * 1000.0 - np.round(stamps * 1000.0)
    assert np.std(off) == pytest.approx(0.1, rel=0.1)
    assert np.all(np.diff(stamps) > 0.0)


def test_the_same_seed_gives_the_same_readings(robots: Robots) -> None:
    encoder = Encoder(2**22, 1000.0, noise=1e-3, jitter_s=1e-4, dropout=0.1)
    first, again, other = (
        fed(LiveEncoders(encoder, robots.finger().motors, [seed])) for seed in (3, 3, 4)
    )
    assert [one.stamp_s for one in first] == [one.stamp_s for one in again]
    np.testing.assert_array_equal([o.values for o in first], [o.values for o in again])
    assert [one.stamp_s for one in first] != [one.stamp_s for one in other]


def test_a_frozen_encoder_repeats_its_last_reading_and_leaves_the_others(robots: Robots) -> None:
    motors = robots.finger().motors
    sensor = LiveEncoders(Encoder(4096, 1000.0), motors, [1])
    assert not sensor.freeze(motors[0].name), "nothing has been read"
    for k in range(100):
        sensor.take(float(TIME[k]), ANGLE[k])
    assert sensor.freeze(motors[0].name)
    assert sensor.frozen == (motors[0].name,)
    readings = [one for k in range(100, 2_000) for one in sensor.take(float(TIME[k]), ANGLE[k])]
    values = np.array([one.values for one in readings])
    assert np.ptp(values[:, 0]) == 0.0
    assert values[0, 0] == pytest.approx(ANGLE[99, 0], abs=0.01)
    assert np.ptp(values[:, 1]) > 0.5
    sensor.thaw()
    (reading,) = sensor.take(float(TIME[2_000]), ANGLE[2_000])
    assert reading.values[0] == pytest.approx(ANGLE[2_000, 0], abs=0.01)


def test_load_cells_read_the_truth_with_their_noise_and_resolution() -> None:
    truth = np.stack([30.0 + TIME, 20.0 - TIME], axis=1)
    cells = LoadCells(rate=100.0)
    readings = fed(LiveCells(cells, 0.02, 2.0**-7, 0.5, [1]), truth)
    stamps = np.array([one.stamp_s for one in readings])
    values = np.array([one.values for one in readings])
    assert stamps.size == 401
    error = values - np.stack([30.0 + stamps, 20.0 - stamps], axis=1)
    assert error.mean() == pytest.approx(0.5, abs=0.003)
    assert error.std() == pytest.approx(0.02, rel=0.1)
    np.testing.assert_array_equal(values * 128.0, np.round(values * 128.0))


@pytest.mark.parametrize("latency", [-1.0, np.nan, 1e3])
def test_an_impossible_latency_is_refused(robots: Robots, latency: float) -> None:
    with pytest.raises(UsageError, match="latency must be in"):
        LiveEncoders(JOINT_ENCODER, robots.finger().motors, [1], latency)
