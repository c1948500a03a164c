"""Any number of motors, joints and cables, by tables or by positions."""

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.model.prepared import prepare
from cdrj_ros.simulation.assembly import divide_contacts
from cdrj_ros.simulation.drives import follow_joints, pull_together
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, sine
from cdrj_ros.simulation.truth import simulate

TIME = np.arange(3_001) / 1000.0


def _moving(robot, share=0.5):
    joints = [
        joint.reference_angle + sine(share * joint.upper, 0.4 + 0.1 * k)(TIME - 0.2)
        for k, joint in enumerate(robot.joints)
    ]
    return np.stack(joints, axis=1)


def _frictionless(robot):
    return replace(robot, cables=tuple(replace(cable, law="none") for cable in robot.cables))


def test_cells_are_fixed_to_the_surface_where_an_end_of_the_arc_moves_on_it(robots):
    def fixed(robot):
        cables = divide_contacts(robot, 8).cables
        return [pulley.cell_width > 0.0 for cable in cables for pulley in cable.pulleys]

    assert fixed(robots.prototype()) == 2 * [False, False, False, False, True, False, False]
    assert fixed(robots.hoist()) == [False], "the hook moves straight down"
    assert all(fixed(robots.finger()))
    assert all(fixed(robots.parallel()))


@pytest.mark.parametrize("name", ["prototype", "finger", "parallel"])
def test_following_motors_keep_the_preload_of_frictionless_cables(robots, name):
    robot = _frictionless(getattr(robots, name)())
    truth = simulate(robot, TIME, _moving(robot), cells=4)
    element = 0
    for cable in robot.cables:
        for _ in cable.element_names:
            np.testing.assert_allclose(truth.tension[:, element], cable.preload, rtol=1e-6)
            element += 1


def test_a_cable_that_no_motor_can_follow_is_named_and_stretches(robots):
    robot = robots.finger()
    single = replace(robot.cables[1].nodes[0], motors=(("flexor_motor", 1.0),), winding=1)
    cables = (
        robot.cables[0],
        replace(robot.cables[1], nodes=(single, *robot.cables[1].nodes[1:])),
    )
    coupled = replace(robot, cables=cables, motors=robot.motors[:1])
    joints = 0.2 * _moving(coupled)
    truth = simulate(coupled, TIME, joints, cells=2)
    (note,) = [note for note in truth.notes if "no motor compensates" in note]
    assert sorted(note.rpartition(": ")[2].split(", ")) == sorted(one.name for one in cables)
    assert np.ptp(truth.tension[:, 0]) > 1.0


def test_several_motors_balance_one_joint_together(robots):
    robot = robots.finger()
    joints = np.zeros((TIME.size, 2))
    joints[:, 1] = sine(0.2, 0.5)(TIME - 0.2)
    load = make_load("pendulum", 0.05)
    torque = load.torque(*differences(TIME, joints[:, 1]))
    truth = simulate(robot, TIME, joints, torque, joint=1, cells=4, motor_acceleration=1e4)
    np.testing.assert_allclose(np.abs(truth.imbalance), 0.0, atol=1e-6)
    np.testing.assert_allclose(truth.joint_effort[:, 1], torque, atol=1e-3)
    followed = follow_joints(prepare(robot), truth.joint_angle).motor_angle
    beyond = truth.motor_angle - followed
    way = pull_together(prepare(robot), 1)
    assert np.abs(way).max() == 1.0
    np.testing.assert_allclose(beyond, np.outer(beyond @ way, way) / (way @ way), atol=1e-9)


def test_a_weight_is_balanced_wherever_it_starts(robots):
    robot = robots.hoist()
    height = 0.3 + sine(0.05, 0.5)(TIME - 0.2)
    load = make_load("lift", 2.0)
    truth = simulate(robot, TIME, height, load.torque(*differences(TIME, height)), cells=4)
    weight = 2.05 * 9.81
    np.testing.assert_allclose(truth.tension[0], weight, rtol=1e-6)
    lifting = np.gradient(truth.joint_angle[:, 0]) > 1e-5
    assert (truth.tension[lifting, 0] > truth.tension[lifting, 1]).mean() > 0.95
    assert truth.motor_angle[0, 0] + 0.5 > 0.3 / 0.03, "ten radians from the reference"


def test_a_motor_keeps_to_its_limits_and_the_motion_waits_for_it(robots):
    robot = robots.prototype()
    angle = sine(0.5, 0.5)(TIME - 0.2)
    torque = make_load("rolling", 0.3, gravity=0.0).torque(*differences(TIME, angle))
    fast = simulate(robot, TIME, angle, torque, 60.0, cells=2)
    slow = simulate(robot, TIME, angle, torque, 2.0, cells=2, motor_acceleration=30.0)
    speed = np.diff(slow.motor_angle[:, 0]) / 1e-3
    assert 1.9 < np.abs(speed).max() <= 2.0 * (1.0 + 1e-9)
    assert np.abs(np.diff(speed)).max() <= 0.03 * (1.0 + 1e-9)
    assert np.abs(slow.imbalance).max() < 0.05, "the cables still balance the load"
    ways = [np.abs(np.diff(truth.joint_angle[:, 0])).sum() for truth in (slow, fast)]
    assert 0.2 < ways[0] < 0.5 * ways[1]
