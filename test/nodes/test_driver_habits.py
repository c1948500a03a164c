"""Stamps, units and messages as drivers are known to send them, and what the node says of each."""

import re

import numpy as np
import pytest
from support.estimators import (
    BEGIN,
    JOINT,
    MILLISECOND,
    MOTOR,
    SECOND,
    diagnosed,
    feed,
    sample_at,
    values_of,
)

from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.packing import OK

HOUR = 3600 * SECOND
EFFORT = Template(JOINT_STATE, ("winch",), ("effort",))


def arrived(estimator, arrival_ns):
    """Let the next message arrive at this time of the node's clock [ns]."""
    estimator.now_ns = lambda: arrival_ns


def fed_without_stamps(estimator, late_ns=0):
    """Feed three seconds of messages; every fourth one of the joint is late."""
    for k in range(0, 3000, 5):
        sample = sample_at(k)
        arrived(estimator, sample.stamp_ns)
        estimator.motor(MOTOR.encode(0, position=sample.motor_angle))
        arrived(estimator, sample.stamp_ns + 500_000 + (late_ns if k % 20 == 0 else 0))
        estimator.joint(JOINT.encode(0, position=sample.joint_angle))


def test_stamps_of_zero_mean_the_time_of_arrival_which_is_said_once(bench, capfd):
    estimator = bench.estimator()
    fed_without_stamps(estimator)
    assert len(estimator.answers) > 1000
    newest_ns = BEGIN + 2995 * MILLISECOND
    assert abs(estimator.latest.stamp_ns - newest_ns) <= MILLISECOND
    assert values_of(diagnosed(estimator)[0])["stamped on arrival"] == (
        "/cdrj/motor_states, /cdrj/joint_states"
    )
    said = capfd.readouterr().err
    assert said.count("the stamps in the headers are zero") == 2, "once per topic"
    assert "Set header.stamp" in said


def test_the_error_of_times_of_arrival_is_in_the_standard_deviations(bench):
    stamped, even, late = bench.estimator(), bench.estimator(), bench.estimator()
    for k in range(0, 3000, 5):
        sample = sample_at(k)
        stamped.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
        stamped.joint(JOINT.encode(sample.stamp_ns + 500_000, position=sample.joint_angle))
    fed_without_stamps(even)
    fed_without_stamps(late, late_ns=4 * MILLISECOND)
    deviations = [float(one.latest.stddev.max()) for one in (stamped, even, late)]
    assert deviations[0] <= deviations[1] < deviations[2]
    assert np.all(stamped.latest.status == OK)
    assert np.any(late.latest.status != OK), "no tension is trusted at unknown times"


def test_load_cells_without_stamp_are_used_at_their_time_of_arrival(bench):
    estimator = bench.estimator(tension_sensors=True)
    cells = Template(CABLE_TENSIONS, ("upper/8",), ("tension", "stddev"))
    for k in range(0, 3000, 5):
        sample = sample_at(k)
        arrived(estimator, sample.stamp_ns)
        estimator.on_tensions(cells.encode(0, tension=[36.0], stddev=[0.1]))
        estimator.joint(JOINT.encode(sample.stamp_ns, position=sample.joint_angle))
        estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
    values = values_of(diagnosed(estimator)[0])
    assert int(values["sensor readings not used in time"]) == 0
    assert int(values["refused: unknown sensor"]) == 0
    said = " ".join(estimator.live.corrections.words().values())
    assert max(int(count) for count in re.findall(r"(\d+) readings", said)) > 100


@pytest.mark.parametrize("begun", [False, True])
def test_a_publisher_three_hours_ahead_is_named_with_its_difference_and_the_remedy(bench, begun):
    estimator = bench.estimator(timeout=0.05)
    if begun:
        feed(estimator, 0, 50)
    for k in range(50, 100):
        sample = sample_at(k)
        arrived(estimator, sample.stamp_ns)
        estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
        estimator.joint(JOINT.encode(sample.stamp_ns + 3 * HOUR, position=sample.joint_angle))
    assert bench.until(lambda: estimator.latest is None or estimator.watch.lost())
    estimator.inputs[1].heard_s = float("inf")  # messages go on
    words = (
        "no common time of all axes: the stamps of elbow are 10800.0 s ahead of those of winch: "
        "synchronise the clocks, or add -10800.0 to the clock_offset of elbow in the robot file"
    )
    assert words in diagnosed(estimator)[0].message


def test_efforts_without_positions_are_used_beside_positions_without_efforts(bench):
    estimator = bench.estimator(track_preload=True)
    for k in range(0, 1000, 5):
        sample = sample_at(k)
        estimator.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
        estimator.motor(EFFORT.encode(sample.stamp_ns, effort=[0.2]))
        estimator.joint(JOINT.encode(sample.stamp_ns, position=sample.joint_angle))
    assert len(estimator.answers) == 200
    assert sum(estimator.live.conditioner.refused.values()) == 0
    assert estimator.live.corrections is not None
    diagnosed(estimator)  # the last message has no positions to look at
