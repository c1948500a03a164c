"""Tracking a lost preload by motor efforts: an estimator over DDS against the simulated rig."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from support.remote import ROBOT, Remote

from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.model.loading import load_model
from cdrj_ros.simulation.faults import Fault
from cdrj_ros.simulation.motion import sine
from cdrj_ros.simulation.sensors import JOINT_ENCODER, MOTOR_ENCODER, read_encoder
from cdrj_ros.simulation.truth import simulate

WHOLE, LOST = "36.85,26.26", "29.48,26.26"
"""Preloads of the robot file, and those after a loss of 20 % in the upper cable [N]."""
LOST_N = 7.37
CREEP = Fault("slack", 7.0, 2.32e-3, "upper")
"""The upper anchor creeps until t = 9 s, when the estimator's standard deviations have decreased.
Both cables then have lost 7.37 N, since they share a motor and balance each other."""
FREQUENCY_HZ = 0.25
EVERY = 2
"""Only every n-th sample of the 250 Hz simulation is read: 125 Hz."""
BURST, AHEAD = 20, 60
"""Samples sent between two checks of the answers, and samples allowed without an answer: together
0.64 s.  Efforts 1 s ahead of the joint's angles are discarded, and topics may arrive one by one."""
MOTOR = Template(JOINT_STATE, ("winch",), ("position", "effort"))
MOTOR_ALONE = Template(JOINT_STATE, ("winch",), ("position",))
JOINT = Template(JOINT_STATE, ("elbow",), ("position",))


@dataclass(frozen=True)
class Measured:
    """Sensor readings and true tensions of the rig, with one row per sample."""

    stamp_ns: np.ndarray
    motor: np.ndarray
    joint: np.ndarray
    effort: np.ndarray
    """Motor effort with noise [N m]."""
    tension: np.ndarray
    """True tension of every element [N], shape (n, elements)."""


@cache
def measure(preload: str, cycles: int, *faults: Fault) -> Measured:
    """Simulate one second of rest and ``cycles`` cycles of a rig with these preloads."""
    time = np.arange(0.0, 1.0 + cycles / FREQUENCY_HZ, 4e-3)
    course = sine(np.radians(38.0), FREQUENCY_HZ, 1.0)(time)
    torque = RollingLoad().torque(course.angle, course.speed, course.acceleration)
    robot = load_model(ROBOT, preload).robot
    truth = simulate(robot, time, course.angle, torque, 20.0, cells=4, faults=faults)
    when = time[::EVERY]
    noise = np.random.default_rng(3).normal(0.0, 0.005, when.size)
    return Measured(
        1_000_000_000 + np.round(when * 1e9).astype(np.int64),
        read_encoder(MOTOR_ENCODER, when, time, truth.motor_angle[:, 0]),
        read_encoder(JOINT_ENCODER, when, time, truth.joint_angle[:, 0]),
        truth.motor_effort[::EVERY, 0] + noise,
        truth.tension[::EVERY],
    )


def send(remote: Remote, measured: Measured, count: int, *, efforts: bool = True) -> None:
    """Send the first ``count`` samples and wait for their estimates."""
    for k in range(count):
        stamp = int(measured.stamp_ns[k])
        remote.inputs["joint_states"].publish(JOINT.encode(stamp, position=measured.joint[k]))
        angle = measured.motor[k]
        remote.inputs["motor_states"].publish(
            MOTOR.encode(stamp, position=angle, effort=measured.effort[k])
            if efforts
            else MOTOR_ALONE.encode(stamp, position=angle)
        )
        if k % BURST == BURST - 1:
            assert remote.until(lambda: len(remote.answers) > k - AHEAD)  # noqa: B023
    assert remote.until(lambda: len(remote.answers) == count)


@pytest.mark.parametrize(
    ("preload", "cycles", "faults", "left"),
    # lost in motion, the bias of the effort may have drifted as well
    [(LOST, 10, (), 0.25), (WHOLE, 12, (CREEP,), 0.5)],
    ids=["before the start", "in motion"],
)
def test_the_motors_effort_recovers_most_of_a_lost_preload_within_ten_cycles(
    brisk_node: Any,
    start_node: Any,
    preload: str,
    cycles: int,
    faults: tuple[Fault, ...],
    left: float,
) -> None:
    measured = measure(preload, cycles, *faults)
    one = Remote(brisk_node, start_node, "tracked")
    one.start(track_preload=True)
    send(one, measured, measured.stamp_ns.size)
    tension, stddev = one.heard()
    tenth = slice(-round(250.0 / FREQUENCY_HZ / EVERY), None)
    error = (tension - measured.tension)[tenth]
    for cable in (slice(0, 8), slice(8, 16)):
        # friction of the motor is an unknown too, which costs accuracy where there is none
        assert np.abs(error[:, cable]).mean() < left * LOST_N
    assert np.mean(np.abs(error) < 2.0 * stddev[tenth]) > 0.92


def test_without_track_preload_efforts_change_no_byte_and_recover_nothing(
    brisk_node: Any, start_node: Any
) -> None:
    measured = measure(LOST, 10)
    count = measured.stamp_ns.size // 4
    told = Remote(brisk_node, start_node, "told")
    told.start(health="report")
    untold = Remote(brisk_node, start_node, "untold")
    untold.start()
    send(told, measured, count)
    send(untold, measured, count, efforts=False)
    assert told.answers == untold.answers
    error = told.heard()[0] - measured.tension[:count]
    assert error[:, :8].mean() > 0.95 * LOST_N
    assert np.abs(error[:, 8:]).mean() < 0.1
