"""Small robots for the tests of the rig."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from support.places import PROTOTYPE

from cdrj_ros.robot.reader import load_robot, parse_robot


def prototype(law=None):
    robot = load_robot(PROTOTYPE)
    if law is None:
        return robot
    return replace(robot, cables=tuple(replace(cable, law=law) for cable in robot.cables))


def finger():
    """Two joints in series, two motors, two cables that each cross both joints, by positions."""
    cable = """
          - name: {name}
            axial_stiffness: 5000
            preload: 20
            nodes:
              - {{type: winch, motor: {name}_motor, radius_mm: 8, winding: 1,
                 position_mm: [-40, {y}], turn: {turn}}}
              - {{type: pulley, radius_mm: 8, position_mm: [0, 0], turn: {turn}}}
              - {{type: pulley, radius_mm: 6, frame: link1, position_mm: [50, 0], turn: {turn}}}
              - {{type: anchor, frame: link2, position_mm: [30, {end}]}}
    """
    return parse_robot(
        """
        name: finger
        motors: [{name: flexor_motor}, {name: extensor_motor}]
        joints:
          - {name: base_joint, range_deg: [-20, 20]}
          - {name: tip_joint, range_deg: [-20, 20]}
        frames:
          - {name: link1, motion: revolute, joint: base_joint}
          - {name: link2, parent: link1, motion: revolute, joint: tip_joint, origin_mm: [50, 0]}
        friction: {mu_c: 0.1}
        cables:
        """
        + cable.format(name="flexor", y=40, end=15, turn="ccw")
        + cable.format(name="extensor", y=-40, end=-15, turn="cw")
    )


def parallel():
    """A platform held by cables over fixed pulleys, a motor each: spans depend on its place."""
    return load_robot(PROTOTYPE.with_name("parallel.yaml"))


def hoist():
    """A weight on a cable without preload, over one pulley; positive lifts."""
    return parse_robot("""
        name: hoist
        motors: [{name: drum}]
        joints: [{name: height, range_mm: [-400, 400]}]
        frames: [{name: hook, motion: prismatic, joint: height, direction: [0, 1]}]
        friction: {mu_c: 0.1}
        cables:
          - name: rope
            axial_stiffness: 20000
            preload: 0
            nodes:
              - {type: winch, motor: drum, radius_mm: 30, winding: 1, position_mm: [-300, 0],
                 turn: cw}
              - {type: pulley, radius_mm: 40, position_mm: [0, 1000], turn: cw}
              - {type: anchor, frame: hook, position_mm: [40, 0]}
        """)


@pytest.fixture(scope="session")
def robots():
    """The robots above, by name."""
    return SimpleNamespace(prototype=prototype, finger=finger, parallel=parallel, hoist=hoist)
