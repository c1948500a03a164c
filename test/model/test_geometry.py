"""Wraps without a jump, and geometries that are refused."""

from math import pi

import numpy as np
from support.refusal import refusal

from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import parse_robot

HEAD = """
name: hand
motors: [{name: m}]
joints: [%s]
frames: [%s]
cables:
  - name: c
    axial_stiffness: 1000
    preload: 1
    nodes:
"""


def routed(nodes, joints="", frames=""):
    """A robot of one cable whose nodes are written one per line."""
    lines = [f"      - {line.strip()}" for line in nodes.strip().splitlines()]
    return prepare(parse_robot(HEAD % (joints, frames) + "\n".join(lines) + "\n"))


def test_a_wrap_grows_through_half_a_turn_without_a_jump():
    model = routed(
        """
        {type: anchor, position: [-4, 0]}
        {type: pulley, radius: 1, position: [0, 1], turn: ccw}
        {type: anchor, frame: arm, position: [0, 4]}
        """,
        "{name: q, range_deg: [-120, 120]}",
        "{name: arm, motion: revolute, joint: q, origin: [0, 1], angle_deg: 60}",
    )
    angles = np.radians(np.linspace(-120.0, 120.0, 97))
    wraps = np.array([shape_at(model, np.array([q])).wrap[0] for q in angles])
    np.testing.assert_allclose(np.diff(wraps), np.diff(angles), atol=1e-9)
    assert wraps[0] < pi / 2 < pi < 1.4 * pi < wraps[-1]


def tabled(term, wrap="1.0"):
    return parse_robot(f"""
        name: tabled
        motors: [{{name: m}}]
        joints: [{{name: q, range: [-1, 1]}}]
        cables:
          - name: c
            axial_stiffness: 1000
            preload: 1
            nodes:
              - {{type: winch, motor: m, winding: 1, radius: 0.1}}
              - {{type: pulley, radius: 0.1, wrap_angle: {wrap}}}
              - {{type: anchor}}
            spans: [0.5, {term}]
        """)


def test_a_wrap_that_rests_at_zero_is_never_negative():
    # a cable that touches its pulley in half of the joint's range only
    wrap = "{joint: q, angle: [-1, 0.13, 1], value: [0, 0, 1.2]}"
    model = prepare(tabled("0.5", wrap))
    wraps = [shape_at(model, np.array([q])).wrap[0] for q in np.linspace(-1.0, 1.0, 5001)]
    assert min(wraps) >= 0.0


def test_a_pulley_that_its_cable_would_leave_is_refused_with_the_angle():
    message = refusal(
        routed,
        """
        {type: anchor, position: [-4, 0]}
        {type: pulley, radius: 1, position: [0, 1], turn: ccw}
        {type: anchor, frame: slide, position: [4, 0.5]}
        """,
        "{name: q, range: [0, 1]}",
        "{name: slide, motion: prismatic, joint: q, direction: [0, -1]}",
    )
    assert message.startswith("cables[0].nodes[1] (c/2) is left by its cable at q = ")
    assert "the wrap angle is -" in message
    assert "must not be negative" in message


def test_a_span_that_shrinks_to_nothing_is_refused():
    message = refusal(lambda text: prepare(tabled(text)), "{joint: q, offset: 0.5, slope: -1}")
    assert message.startswith("cables[0]: element c/2 has the length")
    message = refusal(lambda text: prepare(tabled(text)), "{joint: q, offset: -0.5, slope: 0.1}")
    assert "element c/2 has the length" in message
    assert "reference pose" in message
