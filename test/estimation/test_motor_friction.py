"""Friction of a motor that the robot file does not contain, and sudden changes, by its effort."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
import pytest
from support.places import ROBOT

from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.estimation.lasting_error import MotorFriction
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.faults import Fault
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, sine
from cdrj_ros.simulation.truth import simulate

RATE: Final = 100.0
CYCLE: Final = round(RATE / 0.25)
SNAP: Final = Fault("snap", 13.0, 1e-3, "upper")


@cache
def truth_of(seconds: float, *faults: Fault) -> Truth:
    robot = load_model(ROBOT).robot
    time = np.arange(0.0, seconds, 1.0 / RATE)
    angle = sine(np.radians(35.0), 0.25, 1.0)(time)
    torque = make_load("rolling").torque(*differences(time, angle))
    return simulate(robot, time, angle, torque, 20.0, cells=4, faults=faults)


@dataclass(frozen=True)
class Tracked:
    live: LiveEstimator
    error: np.ndarray
    """Estimate less truth of every tension [N], shape (n, elements)."""
    stddev: np.ndarray
    status: np.ndarray


def track(truth: Truth, friction: float = 0.0, seed: int = 0) -> Tracked:
    """Track preloads by an effort with a noise of 5 mN m and with friction of the motor [N m]."""
    model: Model = load_model(ROBOT)
    live = LiveEstimator(model, Options(track_preload=True))
    generator = np.random.default_rng(seed)
    turned = np.diff(truth.motor_angle[:, 0], prepend=truth.motor_angle[0, 0])
    noise = generator.normal(0.0, 0.005, turned.size)
    efforts = truth.motor_effort[:, 0] - friction * np.tanh(turned / 1e-5) + noise
    rows = []
    for k, time in enumerate(truth.time):
        stamp = 1_000_000_000 + round(time * 1e9)
        live.feed_efforts(stamp, ["winch"], [float(efforts[k])])
        output = live.take(Sample(stamp, truth.motor_angle[k], truth.joint_angle[k]))
        assert output.stddev is not None
        n = truth.tension.shape[1]
        rows.append((output.tension - truth.tension[k], output.stddev[:n], output.status))
    error, stddev, status = (np.array(column) for column in zip(*rows, strict=True))
    return Tracked(live, error, stddev, status)


def covered(tracked: Tracked, part: slice) -> float:
    return float(np.mean(np.abs(tracked.error[part]) <= 2.0 * tracked.stddev[part]))


@pytest.mark.parametrize("friction", [0.0, 0.02])
def test_friction_of_the_motor_is_not_taken_for_preload(friction: float) -> None:
    tracked = track(truth_of(25.0), friction)
    last = slice(-2 * CYCLE, None)
    assert np.abs(tracked.error[last]).mean() < 1.5, "it was 5 N with 20 mN m"
    assert covered(tracked, last) > 0.9
    assert np.mean(tracked.status[last] == 0) > 0.9
    assert tracked.live.fusion is not None
    (found,) = tracked.live.fusion.sensors.motor_friction.values()
    assert abs(found[0] - friction) < 2.0 * found[1]
    assert found[1] < 0.012
    assert tracked.live.fusion.sensors.health["winch"].changes == 0, "nothing happened"


def test_two_standard_deviations_cover_again_soon_after_an_anchor_has_yielded() -> None:
    tracked = track(truth_of(21.0, SNAP))
    begin = round(SNAP.begin * RATE)
    half = CYCLE // 2
    assert covered(tracked, slice(begin - CYCLE, begin)) > 0.9
    assert covered(tracked, slice(begin + half, begin + CYCLE)) > 0.9, "it was 0 to 12 %"
    assert covered(tracked, slice(begin + CYCLE, None)) > 0.9
    assert tracked.live.fusion is not None
    assert tracked.live.fusion.sensors.health["winch"].changes > 0
    assert not tracked.live.fusion.sensors.faults()


def test_the_direction_of_friction_follows_the_motor_within_a_milliradian() -> None:
    robot = load_model(ROBOT).robot
    friction = MotorFriction(robot)
    angles = (0.0, 0.01, 0.02, 0.0195, 0.01, 0.01)
    found = [float(friction.turn(np.array([angle]))[0]) for angle in angles]
    assert found == pytest.approx([0.0, -1.0, -1.0, -0.5, 1.0, 1.0])
    mirrored = replace(robot, motors=(replace(robot.motors[0], effort_sign=-1),))
    other = MotorFriction(mirrored)
    assert [float(other.turn(np.array([angle]))[0]) for angle in angles] == [-one for one in found]


def test_friction_that_the_file_states_is_known_to_thirty_percent() -> None:
    robot = load_model(ROBOT).robot
    motor = robot.motors[0]
    passive = replace(motor.passive, bearing_torque=0.05, bearing_stiffness=50.0)
    stated = MotorFriction(replace(robot, motors=(replace(motor, passive=passive),)))
    assert stated.stddev(0, 0.0) == pytest.approx(0.015)
    assert MotorFriction(robot).stddev(0, 0.5) == pytest.approx(0.05)
