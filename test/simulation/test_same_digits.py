"""The live rig has the digits of ``simulate``: every robot, before faults and after them."""

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.robot.reader import load_robot, parse_robot
from cdrj_ros.simulation.faults import Slip, Snap
from cdrj_ros.simulation.live import LiveRig, LiveSettings
from cdrj_ros.simulation.load import make_load, usual_load, usual_payload
from cdrj_ros.simulation.truth import simulate

SHIPPED = sorted(path.stem for path in ROBOTS.glob("*.yaml") if path.stem != "continuum")
"""The preloads of continuum's single segments balance no load inside their ranges."""
TIME = np.arange(301) / 1000.0

ROUND_BODIES = """
name: bodies
motors: [{name: one}, {name: other}]
joints: [{name: q, range: [-0.6, 0.6]}]
frames: [{name: arm, motion: revolute, joint: q, origin: [0.3, 0, 0], axis: [0, 1, 1]}]
friction: {mu_c: 0.15}
cables:
"""
CABLE = """
  - name: NAME
    axial_stiffness: 1e4
    preload: 30
    nodes:
      - {type: winch, motor: NAME, winding: 1, radius: 0.02, position: [-0.1, SIGN0.0, 0],
         axis: [0, 0, 1], turn: TURN}
      - {type: cylinder, radius: 0.04, position: [0.05, 0, 0], axis: [0.2, 0, 1], turn: TURN}
      - {type: sphere, radius: 0.03, position: [0.2, SIGN0.01, 0.02]}
      - {type: anchor, frame: arm, position: [0.05, SIGN0.04, 0.02]}
"""


def assert_same_digits(robot, load):
    """Drive all motors to and fro, in turn with opposite signs, while two faults happen."""
    first, last = robot.cables[0].name, robot.cables[-1].name
    rest = robot.reference_motors
    signs = np.where(np.arange(rest.size) % 2, -1.0, 1.0)
    motors = rest + np.multiply.outer(0.1 * np.sin(6.0 * TIME), signs)
    faults = (Snap(0.1, 1e-4, first), Slip(0.15, 0.01, last))
    rig = LiveRig(robot, LiveSettings(load, cells=2, faults=faults))
    truth = simulate(
        robot, TIME, motor_angle=motors, load=load, cells=2, start=rig.joint_angle[0],
        faults=faults, allow_slack=True,
    )  # fmt: skip
    rows = [(rig.tension, rig.joint_angle, rig.motor_effort, rig.joint_effort)]
    for k in range(1, TIME.size):
        assert rig.step(motors[k])
        rows.append((rig.tension, rig.joint_angle, rig.motor_effort, rig.joint_effort))
    wanted = (truth.tension, truth.joint_angle, truth.motor_effort, truth.joint_effort)
    for found, true in zip(zip(*rows, strict=True), wanted, strict=True):
        np.testing.assert_array_equal(np.array(found), true)
    assert np.ptp(truth.tension, axis=0).min() > 1e-3, "every element is moved"


@pytest.mark.parametrize("name", SHIPPED)
def test_every_robot_of_the_package(name):
    robot = load_robot(ROBOTS / f"{name}.yaml")
    kind = usual_load(robot, 0)
    assert_same_digits(robot, make_load(kind, usual_payload(robot, 0, kind, 9.81), 0.05))


def test_geodesics_that_are_solved_together():
    """Two cables over cylinders and spheres, which no robot of the package has."""
    sides = (("one", "", "cw"), ("other", "-", "ccw"))
    cables = [
        CABLE.replace("NAME", name).replace("SIGN", sign).replace("TURN", turn)
        for name, sign, turn in sides
    ]
    robot = parse_robot(ROUND_BODIES + "".join(cables))
    assert_same_digits(robot, make_load("pendulum", 0.02, 0.05))
