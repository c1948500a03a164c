"""Robots whose readings are tested: axes as a test describes them, and one cable on a winch."""

from cdrj_ros.robot.reader import parse_robot

CABLE = """
cables:
  - name: c
    axial_stiffness: 1000
    preload: 1
    nodes: [{{type: winch, motor: {motor}, winding: 1, radius: 0.1}}, {{type: anchor}}]
    spans: [{span}]
"""


def robot_of(axes, motor="a", span="1"):
    """A robot with these motors and joints, in YAML, and a cable on the winch of one motor."""
    return parse_robot(axes + CABLE.format(motor=motor, span=span))
