"""The angle between counts: accurate in smooth motion, never outside the band of a reading."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.wound import robot_of

from cdrj_ros._core import TrackingFilter
from cdrj_ros.estimation.conditioner import axes_of, half_width
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.robot.description import Sensor

COUNT = 2 * np.pi / 16_384
SECOND = 1_000_000_000
ROBOT = """
name: tracked
motors: [{name: winch}]
joints: [{name: elbow, range: [-1, 1], resolution: 4e-4, tracking_bandwidth: 12}]
"""


def counted(angle):
    return np.round(angle / COUNT) * COUNT


def tracked(stamps, readings, bandwidth, band, *, adaptive=False):
    filtered, since = TrackingFilter(), np.diff(stamps, prepend=stamps[0])
    return np.array(
        [
            filtered.track(dt_ns, reading, bandwidth, band, adaptive)
            for dt_ns, reading in zip(since.tolist(), readings.tolist(), strict=True)
        ]
    )


@pytest.mark.parametrize("frequency", [0.1, 0.2, 0.3])
def test_tracking_halves_the_quantisation_error_of_a_smooth_motion(frequency):
    time = np.arange(0.0, 20.0, 2e-3)
    truth = 0.66 * np.sin(2 * np.pi * frequency * time)
    stamps = SECOND + np.round(time * 1e9).astype(np.int64)
    angle = tracked(stamps, counted(truth), 12.0, COUNT / 2)
    raw, left = counted(truth) - truth, angle - truth
    assert np.sqrt(np.mean(left**2)) < 0.6 * np.sqrt(np.mean(raw**2))


READING = st.floats(-1e12, 1e12)
STEP = st.sampled_from((1, 1000, 1_000_000, 2_000_000, 999_999_999))


@settings(max_examples=200)
@given(
    st.lists(st.tuples(STEP, READING), min_size=1, max_size=40),
    st.sampled_from((0.1, 12.0, 1000.0)),
    st.sampled_from((1e-6, 1e-3, 10.0)),
    st.booleans(),
)
def test_the_tracked_angle_stays_within_the_band_of_every_reading(
    readings, bandwidth, band, adaptive
):
    filtered = TrackingFilter()
    for step, reading in readings:
        angle = filtered.track(step, reading, bandwidth, band, adaptive)
        assert reading - band <= angle <= reading + band


def test_the_band_is_half_a_count_and_three_deviations_in_angle():
    assert half_width(Sensor(scale=-2.0, resolution=0.01, noise=0.001)) == pytest.approx(0.016)
    assert half_width(Sensor()) == 0.0


def test_the_bandwidth_that_adapts_is_the_fixed_one_at_rest_and_in_slow_motion():
    time = np.arange(0.0, 20.0, 2e-3)
    stamps = SECOND + np.round(time * 1e9).astype(np.int64)
    for truth in (
        np.full(time.size, 0.3),
        0.3 + np.random.default_rng(1).normal(0.0, 0.2 * COUNT, time.size),  # flickers
        np.radians(5.0) * time,
        0.66 * np.sin(2 * np.pi * 0.1 * time),
    ):
        readings = counted(truth)
        band = 1.1 * COUNT
        fixed = tracked(stamps, readings, 12.0, band)
        assert np.array_equal(tracked(stamps, readings, 12.0, band, adaptive=True), fixed)


def error_of(truth, time, bandwidth, *, adaptive=False):
    """Root mean square error after the first second [counts]."""
    stamps = SECOND + np.round(time * 1e9).astype(np.int64)
    angle = tracked(stamps, counted(truth), bandwidth, COUNT / 2, adaptive=adaptive)
    return float(np.sqrt(np.mean(((angle - truth)[time > 1.0] / COUNT) ** 2)))


@pytest.mark.parametrize(("frequency", "amplitude"), [(0.5, 0.66), (1.0, 0.35), (2.0, 0.17)])
def test_the_bandwidth_that_adapts_is_within_a_tenth_of_the_best_fixed_one(frequency, amplitude):
    time = np.arange(0.0, 8.0, 2e-3)
    truth = amplitude * np.sin(2 * np.pi * frequency * time)
    best = min(error_of(truth, time, f) for f in (12.0, 16.0, 20.0, 25.0, 30.0, 35.0, 40.0))
    assert error_of(truth, time, 12.0, adaptive=True) < 1.1 * best


def test_a_bandwidth_that_the_node_is_given_is_fixed():
    robot = robot_of(ROBOT.replace("12}", "12, tracking: adaptive}"), "winch")
    assert [one.adaptive for one in axes_of(robot)] == [False, True]
    assert [one.adaptive for one in axes_of(robot, 20.0)] == [False, False]
    with pytest.raises(RobotFileError, match="tracking needs tracking_bandwidth"):
        robot_of(ROBOT.replace("tracking_bandwidth: 12", "tracking: adaptive"), "winch")


def test_a_filter_without_an_error_to_stay_within_is_refused():
    with pytest.raises(RobotFileError, match=r"tracking_bandwidth needs resolution or noise"):
        robot_of(ROBOT.replace("resolution: 4e-4, ", ""), "winch")
