"""The live rig: bit identity with ``swing``, laws of its motors, and recovery from failures."""

import numpy as np
import pytest
from support.energy import energy

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.simulation.drives import Drives, checked_command, drive_limits
from cdrj_ros.simulation.faults import Snap
from cdrj_ros.simulation.live import LONGEST_PUSH, MOST_TORQUE, LiveRig, LiveSettings
from cdrj_ros.simulation.load import make_load

RATE = 1000.0
LOAD = make_load("rolling", 0.3, 0.05)


def live(robot, load=LOAD, **settings):
    return LiveRig(robot, LiveSettings(load, **{"cells": 2, **settings}))


class Run:
    """A rig and its drives, stepped together; records the truth."""

    def __init__(self, rig, drives):
        self.rig, self.drives = rig, drives
        self.rows = [self._row()]

    def _row(self):
        rig = self.rig
        return rig.tension, rig.joint_angle, rig.motor_angle, rig.motor_effort, rig.joint_effort

    def step(self):
        rig = self.rig
        angle = self.drives.next(
            rig.steps + 1, (rig.steps + 1) / RATE, 1.0 / RATE, rig.motor_effort
        )
        if not rig.step(angle):
            self.drives.stopped(rig.motor_angle)
        self.rows.append(self._row())

    def steps(self, count):
        for _ in range(count):
            self.step()
        return self

    def tell(self, mode, *values):
        command = checked_command(self.drives.limits, mode, values)
        self.drives.command(command, self.rig.time_s)
        return self

    def truth(self):
        """Tensions, joint angles, motor angles, motor and joint efforts, each (steps + 1, ...)."""
        return [np.array(column) for column in zip(*self.rows, strict=True)]


def run_of(robot, load=LOAD, **limits):
    return Run(live(robot, load), Drives(drive_limits(robot, RATE, **limits)))


def test_rotor_joint_and_cables_keep_their_energy_without_friction(robots):
    robot = robots.prototype("none")
    load = make_load("rolling", 0.3)
    rig = live(robot, load, cells=1)
    drives = Drives(
        drive_limits(robot, RATE, rotor_damping=0.0, command_timeout=1e3, max_speed=60.0)
    )
    torque = 0.1 - rig.motor_effort[0]
    run = Run(rig, drives).tell("effort", torque)
    model, inertia = prepare(robot), drives.limits.inertia[0]
    stiffness = np.array([cable.axial_stiffness for cable in robot.cables])
    kept, rotors, work = [], [], []
    for _ in range(200):
        length = shape_at(model, rig.joint_angle).length.reshape(2, 8).sum(axis=1)
        tension, before = rig.tension.reshape(2, 8)[:, 0], drives.speed[0]
        stored = 0.5 * tension**2 / stiffness * length / (1.0 + tension / stiffness)
        moving = energy(load, rig.joint_angle, np.array([rig.joint_speed]))[0]
        work.append(torque * rig.motor_angle[0])
        run.step()
        rotors.append(0.5 * inertia * before * drives.speed[0])  # conserved by leapfrog
        kept.append(rotors[-1] + moving + stored.sum() - work[-1])
    assert not rig.at_stop
    assert 1e-4 < np.max(rotors) < 0.5 * inertia * 60.0**2
    assert np.ptp(kept) < 0.01 * np.ptp(work)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_stop_ends_the_motion_and_releases_the_joint(robots, side):
    rig = live(robots.prototype(), lower=-0.02, upper=0.02)
    rig.push(side * 60.0, 0.3)
    for _ in range(200):
        rig.step(rig.motor_angle)
    assert rig.at_stop
    assert (rig.joint_angle[0], rig.joint_speed) == (side * 0.02, 0.0)
    for _ in range(600):
        rig.step(rig.motor_angle)
    assert not rig.at_stop
    assert abs(rig.joint_angle[0]) < 0.015
    assert rig.unsolved == rig.stalled == 0


def test_a_motor_never_turns_faster_than_it_can(robots):
    for mode, value in (("position", 1.0), ("velocity", 2.0), ("effort", 1.5)):
        run = run_of(robots.prototype(), max_speed=2.0).tell(mode, value).steps(300)
        speed = np.diff(run.truth()[2][:, 0]) * RATE
        assert 1.0 < speed.max() < 2.0 + 1e-9


@pytest.mark.parametrize("mode", ["velocity", "effort"])
def test_a_motor_that_is_no_longer_commanded_holds_its_angle(robots, mode):
    run = run_of(robots.prototype(), command_timeout=0.1).tell(mode, 0.9).steps(105)
    held = run.rig.motor_angle[0]
    assert held > 0.01
    run.steps(200)
    assert run.rig.motor_angle[0] == held
    assert (run.drives.mode, run.drives.timeouts) == ("position", 1)


def test_a_motor_stalls_where_it_would_need_more_than_its_torque(robots):
    run = run_of(robots.prototype(), max_torque=0.5).tell("position", 50.0).steps(2_000)
    settled = np.abs(run.truth()[3][-200:, 0])
    assert settled.max() < 0.7
    assert run.rig.motor_angle[0] < 6.0


def test_a_cable_that_would_be_wound_in_entirely_stalls_its_motor(robots):
    rig = live(robots.prototype())
    before = rig.motor_angle
    for _ in range(3):
        assert not rig.step(np.array([1e4]))
    assert rig.stalled == 3
    np.testing.assert_array_equal(rig.motor_angle, before)
    assert np.isfinite(rig.tension).all()
    assert rig.step(before + 1e-3)


@pytest.mark.parametrize("cable", ["upper", "lower"])
def test_a_cable_whose_anchor_breaks_away_never_pulls_again(robots, cable):
    robot, faults = robots.prototype(), (Snap(0.02, 1.0, cable),)
    run = Run(live(robot, faults=faults), Drives(drive_limits(robot, RATE))).steps(40)
    run.tell("position", 1.0).steps(200).tell("position", -1.0).steps(400)
    torn = run.truth()[0][40:].reshape(-1, 2, 8)[:, 0 if cable == "upper" else 1]
    assert torn.max() < 1e-6
    assert run.rig.unsolved == 0


def test_after_a_reset_pushes_are_gone_and_faults_happen_again(robots):
    robot, faults = robots.prototype(), (Snap(0.1, 1e-4, "upper"),)
    run = Run(live(robot, faults=faults), Drives(drive_limits(robot, RATE)))
    first = run.tell("velocity", 1.0).steps(200).truth()
    run.rig.push(5.0, 10.0)
    run.steps(50)
    run.rig.reset()
    run.drives.reset()
    assert run.rig.pushes == ()
    again = Run(run.rig, run.drives).tell("velocity", 1.0).steps(200).truth()
    for before, after in zip(first, again, strict=True):
        np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize("push", [(np.nan, 1.0), (2 * MOST_TORQUE, 1.0), (1.0, 0.0),
                                  (1.0, np.inf), (1.0, 2 * LONGEST_PUSH)])  # fmt: skip
def test_an_impossible_push_is_refused(robots, push):
    rig = live(robots.prototype())
    with pytest.raises(UsageError, match="must be in"):
        rig.push(*push)
    assert rig.pushes == ()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"lower": 0.1, "upper": -0.1}, "the stops of elbow"),
        ({"lower": -2.0}, "the stops of elbow"),
    ],
)
def test_impossible_settings_are_refused(robots, settings, words):
    with pytest.raises(UsageError, match=words):
        live(robots.prototype(), **settings)
