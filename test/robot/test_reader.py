# ruff: noqa: E501 (one mistake per line)
"""A robot file is read, or refused with one line naming the key, the value and what is allowed."""

from math import pi, radians

import numpy as np
import pytest
from support.refusal import refusal

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Anchor, Pulley, Winch
from cdrj_ros.robot.document import MAXIMUM_BYTES
from cdrj_ros.robot.reader import load_robot, parse_robot

SMALL = """\
name: small
motors:
  - name: m
    max_speed: 50
joints:
  - name: q
    range: [-1, 1]
frames:
  - name: arm
    motion: revolute
    joint: q
    origin: [1, 0]
friction:
  mu_c: 0.1
cables:
  - name: c
    axial_stiffness: 1000
    preload: 5
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.01}
      - {type: pulley, radius: 0.02, wrap_angle: 1.5, bearing_diameter: 0.01}
      - {type: anchor}
    spans: [0.5, {joint: q, offset: 0.4, angle: [-1, 0, 1], value: [0, 0.1, 0.3]}]
  - name: r
    youngs_modulus: 2.0e+11
    diameter: 0.0002
    preload: 5
    nodes:
      - {type: winch, motor: m, winding: -1, radius: 0.01, position: [0, 0], turn: ccw}
      - {type: pulley, radius: 0.02, position: [1, 0], turn: cw}
      - {type: anchor, frame: arm, position: [0.5, -1]}
"""


def changed(old, new, count=1):
    assert SMALL.count(old) >= 1, f"the file has no {old!r}"
    return SMALL.replace(old, new, count)


def refused(text):
    """The one-line message with which a text is refused."""
    message = refusal(lambda: prepare(parse_robot(text, "arm.yaml")))
    assert "arm.yaml" in message
    assert len(message) < 500
    return message


def test_a_good_file_becomes_a_robot():
    robot = parse_robot(SMALL, "arm.yaml")
    assert (robot.name, robot.source) == ("small", "arm.yaml")
    assert [motor.max_speed for motor in robot.motors] == [50.0]
    assert (robot.joints[0].lower, robot.joints[0].upper) == (-1.0, 1.0)
    tabled, routed = robot.cables
    assert (tabled.placed, routed.placed) == (False, True)
    assert tabled.axial_stiffness == 1000.0
    assert routed.axial_stiffness == pytest.approx(2e11 * pi * 1e-8)
    winch, pulley, anchor = tabled.nodes
    assert isinstance(winch, Winch)
    assert isinstance(anchor, Anchor)
    assert isinstance(pulley, Pulley)
    assert (pulley.friction.mu_c, pulley.friction.mu_s) == (0.1, 0.1)
    assert tabled.law == "elastoplastic"
    assert tabled.element_names == ("c/1", "c/2")
    assert tabled.pulley_names == ("c/2",)
    assert prepare(robot).layout.elements == ("c/1", "c/2", "r/1", "r/2")


def test_units_in_keys_are_converted():
    text = changed("range: [-1, 1]", "range_deg: [-90, 45]")
    text = text.replace("angle: [-1, 0, 1], value: [0, 0.1, 0.3]", "slope_mm: 20")
    text = text.replace("radius: 0.02, wrap_angle: 1.5", "radius_mm: 20, wrap_angle_deg: 90")
    robot = parse_robot(
        text.replace("2.0e+11", "2e11").replace("diameter: 0.0002", "diameter_mm: 0.2")
    )
    assert (robot.joints[0].lower, robot.joints[0].upper) == (radians(-90), radians(45))
    pulley = robot.cables[0].pulleys[0]
    assert pulley.radius == pytest.approx(0.02)
    assert pulley.wrap[0].value[0] == pytest.approx(pi / 2)
    span = robot.cables[0].spans[1][0]
    np.testing.assert_allclose(span.slope, 0.02)
    assert robot.cables[1].axial_stiffness == pytest.approx(2e11 * pi * 1e-8)


def test_friction_is_overridden_key_by_key():
    text = changed("preload: 5\n    nodes", "preload: 5\n    friction: {rho: 0.5}\n    nodes")
    text = text.replace("bearing_diameter: 0.01", "friction: {mu_c: 0.3}")
    first, second = (cable.pulleys[0].friction for cable in parse_robot(text).cables)
    assert (first.mu_c, first.mu_s, first.rho) == (0.3, 0.3, 0.5)
    assert (second.mu_c, second.mu_s, second.rho) == (0.1, 0.1, 1.0)


@pytest.mark.parametrize("moving_end", ["before", "after", "both"])
def test_the_end_that_moves_is_the_one_in_the_file(moving_end):
    for wrap in (TURNED, f"wrap_angle: [1, {TURNED.removeprefix('wrap_angle: ')}]"):
        robot = parse_robot(changed(WRAP, f"{wrap}, moving_end: {moving_end}"))
        assert [cable.pulleys[0].moving_end for cable in robot.cables] == [moving_end, "both"]


WRAP = "wrap_angle: 1.5"
TURNED = "wrap_angle: {joint: q, offset: 1.5, slope: 0.2}"
TABLE = "angle: [-1, 0, 1], value: [0, 0.1, 0.3]"
REFUSED = {
    "unknown key": ("mu_c: 0.1", "mu_cc: 0.1", "friction.mu_cc is not a known key", "did you mean mu_c?"),
    "unknown key like none": ("mu_c: 0.1", "zzzz: 0.1", "friction.zzzz is not a known key", "there are bearing_friction,"),
    "negative radius": ("radius: 0.01}", "radius: -0.01}", "cables[0].nodes[0].radius", "greater than 0, got -0.01"),
    "zero wrap": (WRAP, "wrap_angle: 0", "cables[0].nodes[1].wrap_angle", "greater than 0 rad, got 0"),
    "friction in per cent": ("mu_c: 0.1", "mu_c: 15", "friction.mu_c", "at most 2, got 15"),
    "missing key": ("    preload: 5\n", "", "cables[0].preload is missing", "[N]"),
    "missing joints": ("joints:\n  - name: q\n    range: [-1, 1]\n", "", "joints is missing", "angles are measured"),
    "missing position": (", position: [1, 0], turn: cw", "", "cables[1].nodes[1].position is missing", "positions of its nodes"),
    "text for a number": ("mu_c: 0.1", "mu_c: much", "friction.mu_c must be of type number", "'much'"),
    "nothing for a number": ("preload: 5", "preload:", "cables[0].preload must be of type number", "None"),
    "list for a mapping": ("friction:\n  mu_c: 0.1", "friction: [0.1]", "friction must be of type object", "[0.1]"),
    "not a number": ("preload: 5", "preload: .nan", "cables[0].preload must be a finite number", "nan"),
    "tiny period": ("max_speed: 50", "period: 9.9e-7", "motors[0].period must be at least 1e-06", "9.9e-07"),
    "too large for a number": ("preload: 5", "preload: 1e400", "cables[0].preload must be a finite number", "inf"),
    "duplicate key": ("name: small", "name: small\nname: big", "is not YAML", "'name' is given twice in line"),
    "duplicate cable": ("- name: r\n", "- name: c\n", "cables[1].name", "'c' is taken already"),
    "unknown motor": ("motor: m,", "motor: n,", "cables[0].nodes[0].motor must be one of m", "got 'n'"),
    "unknown joint": ("{joint: q,", "{joint: p,", "cables[0].spans[1].joint must be one of q", "got 'p'"),
    "unknown frame": ("frame: arm", "frame: leg", "cables[1].nodes[2].frame must be one of arm, base", "got 'leg'"),
    "unknown parent": ("    joint: q", "    joint: q\n    parent: leg", "frames[0].parent must name an earlier frame", "got 'leg'"),
    "reserved frame": ("- name: arm", "- name: base", "frames[0].name", "always there"),
    "unknown law": ("mu_c: 0.1", "mu_c: 0.1\n  law: dahl", "friction.law must be one of none, euler, steady", "'dahl'"),
    "units twice": ("max_speed: 50", "max_speed: 50\n    max_speed_deg: 3000", "motors[0].max_speed_deg is given twice", "different units"),
    "too few spans": ("spans: [0.5, {", "spans: [{", "cables[0].spans must have one entry per element", "2 for 3 nodes, got 1"),
    "table too short": ("angle: [-1, 0, 1]", "angle: [-0.5, 0, 1]", "cables[0].spans[1].angle must cover the range [-1, 1]", "got [-0.5, 1]"),
    "table not increasing": ("angle: [-1, 0, 1]", "angle: [-1, 1, 1]", "cables[0].spans[1].angle", "must increase"),
    "table of unequal rows": ("value: [0, 0.1, 0.3]", "value: [0, 0.1]", "cables[0].spans[1].value must have 3 entries", "got 2"),
    "table without values": (TABLE, "angle: [-1, 0, 1]", "cables[0].spans[1]", "needs both angle and value"),
    "range backwards": ("range: [-1, 1]", "range: [1, -1]", "joints[0].range must increase", "[1.0, -1.0]"),
    "reference outside": ("range: [-1, 1]", "range: [-1, 1]\n    reference_angle: 2", "joints[0].reference_angle must lie in the range [-1, 1]", "got 2"),
    "mu_s below mu_c": ("mu_c: 0.1", "mu_c: 0.1\n  mu_s: 0.05", "friction.mu_s must be at least mu_c = 0.1", "got 0.05"),
    "no stribeck_speed": ("mu_c: 0.1", "mu_c: 0.1\n  mu_s: 0.2", "friction.stribeck_speed is missing", "must be given"),
    "no scale of bedding": ("preload: 5", "preload: 5\n    bedding_strain: 0.002", "cables[0].bedding_tension is missing", "tension [N] at which half"),
    "no scale of creep": ("preload: 5", "preload: 5\n    creep_share: 0.1", "cables[0].creep_time is missing", "time constant [s] must be given"),
    "law of a pulley": (WRAP, f"{WRAP}, friction: {{law: lugre}}", "cables[0].nodes[1].friction.law", "same for a whole cable"),
    "stiffness twice": ("axial_stiffness: 1000", "axial_stiffness: 1000\n    diameter: 0.1", "cables[0] needs either axial_stiffness", "diameter"),
    "winch inside": ("- {type: pulley, radius: 0.02, w", "- {type: anchor}\n      - {type: pulley, radius: 0.02, w", "cables[0].nodes[1].type must be pulley between the ends", "got anchor"),
    "pulley at an end": ("- {type: anchor}", f"- {{type: pulley, radius: 1, {WRAP}}}", "cables[0].nodes[2].type must be winch or anchor", "got pulley"),
    "one node": ("      - {type: pulley, radius: 0.02, wrap_angle: 1.5, bearing_diameter: 0.01}\n      - {type: anchor}\n", "", "cables[0].nodes needs at least 2 entries", "got 1"),
    "wrap where it follows": ("position: [1, 0]", f"position: [1, 0], {WRAP}", "cables[1].nodes[1].wrap_angle", "must not be given"),
    "moving end of a constant wrap": (WRAP, f"{WRAP}, moving_end: after", "cables[0].nodes[1].moving_end is allowed only where wrap_angle is a function of a joint", "got 'after'"),
    "moving end beside a position": ("position: [1, 0]", "position: [1, 0], moving_end: before", "cables[1].nodes[1].moving_end follows from the positions", "got 'before'"),
    "moving end of a winch": ("radius: 0.01}", "radius: 0.01, moving_end: before}", "cables[0].nodes[0].moving_end is not a known key", "there are axis,"),
    "position beside spans": ("{type: anchor}", "{type: anchor, position: [1, 1]}", "cables[0].nodes[2].position", "described by spans"),
    "turn of a point": ("position: [0.5, -1]", "position: [0.5, -1], turn: cw", "cables[1].nodes[2].turn", "no meaning for a point"),
    "direction of a revolute frame": ("    joint: q", "    joint: q\n    direction: [1, 0]", "frames[0].direction", "prismatic"),
    "no direction": ("motion: revolute", "motion: prismatic\n    direction: [0, 0]", "frames[0].direction", "must not be zero"),
    "joint of a fixed frame": ("motion: revolute", "motion: fixed", "frames[0].joint", "no meaning"),
    "gear of another program": ("    max_speed: 50", "    gear_ratio: 50", "motors[0].gear_ratio is not a known key", "scale: 1/N"),
    "torque constant": ("mu_c: 0.1", "torque_constant: 0.06", "friction.torque_constant is not a known key", "effort_scale"),
    "no effort": ("    max_speed: 50", "    effort_scale: 0", "motors[0].effort_scale must not be 0", "efforts would be 0"),
    "name of an element": ("  - name: m\n", "  - name: c/1\n  - name: m\n", "the name 'c/1' of a motor", "is that of an element"),
    "name with a blank": ("name: small", "name: very small", "name must be a name of letters", "'very small'"),
    "prefix with a blank": (
        "name: small", 'name: small\nprefix: "arm 1_"', "prefix must be a text of letters, digits and", "'arm 1_'",
    ),
    "unfinished list": ("range: [-1, 1]", "range: [-1, 1", "is not YAML", "line"),
    "empty file": (SMALL, "", "must hold a mapping", "motors, joints and cables"),
    "no cables": (SMALL, "name: a\nmotors: []\njoints: []\ncables: []\n", "cables needs at least 1 entries", "got 0"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", REFUSED)
def test_a_mistake_is_refused_in_one_line_with_key_value_and_allowed_values(mistake):
    old, new, *parts = REFUSED[mistake]
    message = refused(changed(old, new))
    for part in parts:
        assert part in message


def test_a_bearing_that_cannot_turn_is_refused():
    text = changed("mu_c: 0.1", "mu_c: 0.1\n  bearing_friction: 0.9")
    assert "cables[0].nodes[1].bearing_diameter times bearing_friction 0.9" in refused(
        text.replace("bearing_diameter: 0.01", "bearing_diameter: 0.03")
    )


def test_a_unit_inside_a_unit_is_refused_and_not_applied_twice():
    # converting degrees twice would make the wrap angle 57 times too small
    refused(changed(WRAP, "wrap_angle_deg: {joint: q, offset_deg: 90}"))
    refused(
        changed(
            "spans: [0.5, {joint: q, offset: 0.4,", "spans_mm: [500, {joint: q, offset_mm: 400,"
        )
    )


def load_refusal(path):
    message = refusal(load_robot, path)
    assert str(path) in message
    return message


def test_files_that_cannot_be_read_are_refused_by_path(tmp_path):
    assert "No such file" in load_refusal(tmp_path / "absent.yaml")
    assert "Is a directory" in load_refusal(tmp_path)
    empty = tmp_path / "empty.yaml"
    empty.touch()
    assert "must hold a mapping" in load_refusal(empty)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes("name: für\n".encode("latin-1"))
    assert "is not UTF-8 text" in load_refusal(latin)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(bytes(range(256)))
    load_refusal(binary)
    huge = tmp_path / "huge.yaml"
    huge.write_bytes(b"#" * (MAXIMUM_BYTES + 1))
    assert f"it has {MAXIMUM_BYTES + 1} bytes, at most {MAXIMUM_BYTES}" in load_refusal(huge)


def test_escapes_in_keys_and_values_are_shown_and_not_sent_to_the_terminal():
    for text in (
        changed("mu_c: 0.1", '"mu\\e[31m": 0.1'),
        changed("name: small", 'name: "s\\e[2J"'),
        changed("name: small", '"\\ud800": 1'),
        changed("motor: m", 'motor: "\\ud800m"'),
    ):
        assert refused(text).isprintable()


def test_a_path_that_is_not_printable_is_escaped_in_the_error(tmp_path):
    with pytest.raises(RobotFileError) as error:
        load_robot(tmp_path / "\udc80\x1b[2J.yaml")
    assert str(error.value).isprintable()
    with pytest.raises(RobotFileError, match="null"):
        load_robot("a\0b.yaml")
