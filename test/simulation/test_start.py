"""Where the free joint is at the start: held by its cables or on an end stop, in every robot."""

import numpy as np
import pytest
from support.places import ROBOTS, shipped_once

from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.simulation.drives import BEGIN_S, program_of
from cdrj_ros.simulation.live import LiveRig, LiveSettings
from cdrj_ros.simulation.load import make_load, usual_load, usual_payload


def rig_of(model, joint, payload, gravity=9.81):
    load = make_load(usual_load(model.robot, joint), payload, 0.05, gravity)
    return LiveRig(model.robot, LiveSettings(load, cells=1, joint=joint))


@pytest.mark.parametrize("name", sorted(path.stem for path in ROBOTS.glob("*.yaml")))
def test_every_joint_of_every_robot_rests_at_the_start_and_then_moves(name):
    model = prepare(shipped_once(name))
    for place, axis in enumerate(model.robot.joints):
        if axis.name.startswith("segment_") and axis.name not in ("segment_1", "segment_8"):
            continue
        payload = usual_payload(model.robot, place, usual_load(model.robot, place), 9.81)
        assert 0.0 < payload <= 0.3
        rig = rig_of(model, place, payload)
        begin = rig.joint_angle[place]
        assert rig.at_stop == (begin in (axis.lower, axis.upper))
        for _ in range(200):
            assert rig.step(rig.motor_angle)
        assert abs(rig.joint_angle[place] - begin) < 0.01 * (axis.upper - axis.lower)
        program = program_of(model, place, 1000.0, "ramps")
        angles = [program(round(1000.0 * (BEGIN_S + after))) for after in (-0.5, 2.0)]
        assert np.abs(angles[1] - angles[0]).max() > 0.0
        assert np.allclose(angles[0], [motor.reference_angle for motor in model.robot.motors])


def test_a_load_that_the_cables_do_not_hold_rests_on_an_end_stop():
    """Gravity against positive angles presses it to the lower stop, and along them to the upper."""
    robot = load_model("prototype").robot
    for gravity, stop in ((9.81, -0.2), (-9.81, 0.3)):
        load = make_load("rolling", 500.0, 0.05, gravity)
        rig = LiveRig(robot, LiveSettings(load, cells=1, lower=-0.2, upper=0.3))
        assert rig.at_stop
        assert rig.joint_angle[0] == stop
        assert rig.step(rig.motor_angle)
        assert rig.at_stop
        assert rig.joint_angle[0] == stop
