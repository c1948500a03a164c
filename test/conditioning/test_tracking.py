"""The angle between counts: accurate in smooth motion, never outside the band of a reading."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cdrj_ros.conditioning.time_line import Conditioner
from cdrj_ros.conditioning.tracking import half_width, new_track, track, track_all
from cdrj_ros.conditioning.whole_recording import condition
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.series import Series
from cdrj_ros.robot.description import Sensor
from cdrj_ros.robot.reader import parse_robot

COUNT = 2 * np.pi / 16_384
SECOND = 1_000_000_000
ROBOT = """
name: tracked
motors: [{name: winch}]
joints: [{name: elbow, range: [-1, 1], resolution: 4e-4, tracking_bandwidth: 12}]
cables:
  - name: c
    axial_stiffness: 1000
    preload: 1
    nodes: [{type: winch, motor: winch, winding: 1, radius: 0.1}, {type: anchor}]
    spans: [1]
"""


def counted(angle: np.ndarray) -> np.ndarray:
    return np.round(angle / COUNT) * COUNT


def tracked(stamps: np.ndarray, readings: np.ndarray, bandwidth: float, band: float) -> np.ndarray:
    angle = np.empty_like(readings)
    track_all(stamps, readings, bandwidth, band, angle)
    return angle


@pytest.mark.parametrize("frequency", [0.1, 0.2, 0.3])
def test_tracking_halves_the_quantisation_error_of_a_smooth_motion(frequency: float) -> None:
    time = np.arange(0.0, 20.0, 2e-3)
    truth = 0.66 * np.sin(2 * np.pi * frequency * time)
    stamps = SECOND + np.round(time * 1e9).astype(np.int64)
    angle = tracked(stamps, counted(truth), 12.0, COUNT / 2)
    raw, left = counted(truth) - truth, angle - truth
    assert np.sqrt(np.mean(left**2)) < 0.6 * np.sqrt(np.mean(raw**2))


def test_constant_acceleration_is_followed_without_lag() -> None:
    dt = np.random.default_rng(1).choice([1e-3, 2e-3, 5e-3], 2000)
    stamps = SECOND + np.cumsum(np.round(dt * 1e9).astype(np.int64))
    time = (stamps - stamps[0]) * 1e-9
    truth = 0.1 + 0.5 * time + 0.4 * time**2
    left = np.abs(tracked(stamps, truth, 12.0, 1.0) - truth)
    assert left.max() < 1e-5  # at first the uneven steps cause a small error
    assert left[200:].max() < 1e-9


def test_at_rest_the_tracked_angle_is_the_reading() -> None:
    stamps = SECOND + np.arange(5000) * 2_000_000
    reading = np.concatenate([np.linspace(0.0, 0.1, 1000), np.full(4000, 0.1)])
    angle = tracked(stamps, reading, 12.0, COUNT / 2)
    np.testing.assert_allclose(angle[-2000:], 0.1, rtol=0, atol=1e-9)


READING = st.floats(-1e12, 1e12)
STEP = st.sampled_from((1, 1000, 1_000_000, 2_000_000, 999_999_999))


@settings(max_examples=200)
@given(
    st.lists(st.tuples(STEP, READING), min_size=1, max_size=40),
    st.sampled_from((0.1, 12.0, 1000.0)),
    st.sampled_from((1e-6, 1e-3, 10.0)),
)
def test_the_tracked_angle_stays_within_the_band_of_every_reading(
    readings: list[tuple[int, float]], bandwidth: float, band: float
) -> None:
    memory = new_track()
    for step, reading in readings:
        angle = track(memory, step, reading, bandwidth, band)
        assert reading - band <= angle <= reading + band


def test_the_band_is_half_a_count_and_three_deviations_in_angle() -> None:
    assert half_width(Sensor(scale=-2.0, resolution=0.01, noise=0.001)) == pytest.approx(0.016)
    assert half_width(Sensor()) == 0.0


def test_the_node_path_and_the_bulk_path_agree_bit_for_bit_across_a_silence() -> None:
    robot = parse_robot(ROBOT)
    time = np.arange(0.0, 4.0, 2e-3)
    time = time[(time < 1.0) | (time > 1.9)]
    stamps = SECOND + np.round(time * 1e9).astype(np.int64)
    joint = np.round(0.5 * np.sin(time) / 4e-4) * 4e-4
    whole = condition(
        robot,
        {"winch": Series(stamps, stamps, np.zeros(time.size))},
        {"elbow": Series(stamps, stamps, joint)},
    ).segments[0]
    conditioner = Conditioner(robot)
    samples = []
    for stamp, angle in zip(stamps.tolist(), joint.tolist(), strict=True):
        samples += conditioner.feed_motors(stamp, ("winch",), (0.0,))
        samples += conditioner.feed_joints(stamp, ("elbow",), (angle,))
    live = np.concatenate([sample.joint_angle for sample in samples])
    assert np.array_equal(live, whole.joint_angle[:, 0])
    assert not np.array_equal(live, joint)
    assert live[time > 1.9][0] == joint[time > 1.9][0]  # it restarts after the silence


def test_a_filter_without_an_error_to_stay_within_is_refused() -> None:
    with pytest.raises(RobotFileError, match=r"tracking_bandwidth needs resolution or noise"):
        parse_robot(ROBOT.replace("resolution: 4e-4, ", ""))
