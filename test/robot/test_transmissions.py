"""Transmissions of a URDF: their linear maps, and what of them is in the robot file."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.followers import assert_same_tensions_and_work

from cdrj_ros.commands import import_robot
from cdrj_ros.foundation.files import parse_xml
from cdrj_ros.foundation.yaml import load_yaml
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.robot.transmissions import transmissions_of

AR, JR, OFF = (50.0, -40.0), (2.0, 0.8), (0.1, -0.3)


def differential(a):
    """Joints of a differential, as its class in ros2_control documents them."""
    one, two = a[0] / AR[0], a[1] / AR[1]
    return np.array([(one + two) / (2 * JR[0]) + OFF[0], (one - two) / (2 * JR[1]) + OFF[1]])


def four_bar(a):
    """Joints of a four-bar linkage, as its class in ros2_control documents them."""
    first = a[0] / (JR[0] * AR[0])
    return np.array([first + OFF[0], (a[1] / AR[1] - first) / JR[1] + OFF[1]])


def wrist(a):
    """Flexion and roll of the wrist of pr2_mechanism_model, from its right and left actuator."""
    right, left = a[0] / AR[0], a[1] / AR[1]
    return np.array([(right - left) / (2 * JR[0]), (-right - left) / (2 * JR[1])])


def simple(a):
    return a / JR[0] + OFF[0]


def ros2(kind):
    """A transmission as ros2_control has it."""
    actuators = "".join(
        f'<actuator name="a{k}" role="actuator{k}"><mechanical_reduction>{AR[k - 1]}'
        "</mechanical_reduction></actuator>" for k in (1, 2)
    )  # fmt: skip
    joints = "".join(
        f'<joint name="j{k}" role="joint{k}"><mechanical_reduction>{JR[k - 1]}'
        f"</mechanical_reduction><offset>{OFF[k - 1]}</offset></joint>" for k in (1, 2)
    )  # fmt: skip
    plugin = f"<plugin>transmission_interface/{kind}</plugin>"
    return f'<transmission name="t">{plugin}{actuators}{joints}</transmission>'


ACTUATORS = """<type>transmission_interface/DifferentialTransmission</type>
  <actuator name="a1"><role>actuator1</role><mechanicalReduction>50</mechanicalReduction></actuator>
  <actuator name="a2"><role>actuator2</role><mechanicalReduction>-40</mechanicalReduction></actuator>"""  # noqa: E501
JOINTS = [
    f"""<joint name="j{k}"><role>joint{k}</role><offset>{OFF[k - 1]}</offset>
    <mechanicalReduction>{JR[k - 1]}</mechanicalReduction></joint>"""
    for k in (1, 2)
]
"""Of a transmission of ROS 1, whose order does not count."""


def ros1(*joints):
    return f'<transmission name="t">{ACTUATORS}{"".join(joints)}</transmission>'


PR2 = """<transmission name="t" type="pr2_mechanism_model/WristTransmission">
  <rightActuator mechanicalReduction="50" name="a1"/><leftActuator mechanicalReduction="-40" name="a2"/>
  <flexJoint mechanicalReduction="2" name="j1"/><rollJoint mechanicalReduction="0.8" name="j2"/>
</transmission>"""  # noqa: E501

UNORDERED = re.sub(r'role="(joint|actuator).', r'role="\1', ros2("DifferentialTransmission"))

MAPS = {
    "with roles that give no order": (UNORDERED, differential),
    "DifferentialTransmission": (ros2("DifferentialTransmission"), differential),
    "FourBarLinkageTransmission": (ros2("FourBarLinkageTransmission"), four_bar),
    "of ROS 1": (ros1(*JOINTS), differential),
    "of ROS 1, in another order": (ros1(*reversed(JOINTS)), differential),
    "of the PR2": (PR2, wrist),
}


def at(linear, given):
    """The value of a linear function."""
    return linear.offset + sum(share * given[name] for name, share in linear.shares)


def read(text):
    (found,) = transmissions_of(parse_xml(f"<robot>{text}</robot>".encode()), Path("arm.urdf"))
    return found


@pytest.mark.parametrize("name", MAPS)
def test_the_map_is_the_documented_one_and_its_inverse_leads_back(name):
    text, joints_of = MAPS[name]
    found = read(text)
    for seed in range(20):
        angles = np.random.default_rng(seed).uniform(-30.0, 30.0, 2)
        given = dict(zip(("a1", "a2"), angles, strict=True))
        joints = {one: at(linear, given) for one, linear in found.joints.items()}
        np.testing.assert_allclose(
            [joints["j1"], joints["j2"]], joints_of(angles), rtol=1e-13, atol=1e-14
        )
        back = {one: at(linear, joints) for one, linear in found.actuators.items()}
        np.testing.assert_allclose([back["a1"], back["a2"]], angles, rtol=1e-12, atol=1e-12)


def test_the_first_joint_of_a_four_bar_linkage_follows_the_first_actuator_alone():
    found = read(ros2("FourBarLinkageTransmission"))
    assert [name for name, _ in found.joints["j1"].shares] == ["a1"]
    assert [name for name, _ in found.actuators["a1"].shares] == ["j1"]


@pytest.mark.parametrize(
    ("right", "wrong", "reason"),
    [
        ("DifferentialTransmission", "ScrewTransmission", "ScrewTransmission is not known"),
        ("transmission_interface/", "mine/", "DifferentialTransmission of mine is not known"),
        (">50.0<", ">0<", "has a reduction of 0"),
        ('role="joint1"', 'role="joint2"', "the roles of its joints are not joint1, joint2"),
        ('<joint name="j2"', '<joints name="j2"', "has 1 joint and 2 actuators"),
        ('name="j2"', 'name="j1"', "its joints have no names of their own"),
        ('name="j2"', 'name="a1"', "joints and actuators of it have the same names"),
    ],
)
def test_what_is_no_known_map_has_none_and_says_why(right, wrong, reason):
    text = ros2("DifferentialTransmission").replace(right, wrong)
    text = text.replace("</joint></trans", "</joints></trans") if wrong.startswith("<j") else text
    found = read(text)
    assert reason in found.refused
    assert not any(one.shares for one in (*found.joints.values(), *found.actuators.values()))


def test_a_simple_transmission_with_two_reductions_has_no_gear():
    """ros2_control takes the joint's, ROS 1 the actuator's."""
    text = ros2("SimpleTransmission")
    one = re.sub(r'<(actuator|joint) name=".2".*?</\1>', "", text)
    assert "has the reductions 50 and 2" in read(one).refused
    plain = read(one.replace(">50.0<", ">1<"))
    assert at(plain.joints["j1"], {"a1": 7.0}) == pytest.approx(simple(np.array(7.0)))


ARM = """<robot name="arm"><link name="base"/><link name="upper"/><link name="hand"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
  <origin xyz="0.1 0 0"/><limit lower="-0.4" upper="0.5" effort="1" velocity="2"/></joint>
<joint name="j2" type="revolute"><parent link="upper"/><child link="hand"/><axis xyz="1 0 0"/>
  <origin xyz="0.1 0 0"/><limit lower="-0.6" upper="0.3" effort="1" velocity="3"/></joint>
<ros2_control name="s" type="system">%s</ros2_control></robot>"""

POSITION = '<state_interface name="position"/>'


def driven(*names):
    command = '<command_interface name="effort"/>'
    return "".join(f'<joint name="{name}">{command}{POSITION}</joint>' for name in names)


def measured(*names):
    return "".join(f'<joint name="{name}">{POSITION}</joint>' for name in names)


def begun(control, folder):
    """The robot file that is begun, and its text."""
    source, out = folder / "arm.urdf", folder / "arm.yaml"
    source.write_text(ARM % control)
    assert import_robot.main([str(source), "--out", str(out)]) == 0
    text = out.read_text()
    return load_yaml(text, str(out)), text


CABLES = """cables:
  - name: c
    axial_stiffness: 6e4
    preload: 20
    nodes:
      - {type: winch, motor: %s, winding: 1, radius: 0.015, position: [0, 0, 0.05]}
      - {type: eyelet, frame: upper, position: [0.05, 0.01, 0.03]}
      - {type: anchor, frame: hand, position: [0.05, 0.02, 0.02]}
"""


def test_drums_behind_a_differential_are_sums_of_its_actuators(tmp_path, capsys):
    document, text = begun(
        driven("a1", "a2") + measured("j1", "j2") + ros2("DifferentialTransmission"), tmp_path
    )
    assert document["motors"] == [{"name": "a1"}, {"name": "a2"}]
    assert [joint["name"] for joint in document["joints"]] == ["j1", "j2"]
    said = capsys.readouterr().out
    share = "couples j1, j2 to a1, a2: a drum that turns with j1 has motor: "
    assert share in said
    assert share in text
    (given,) = re.findall(r"turns with j1 has motor: ({[^}]*})", said)
    (tmp_path / "arm.yaml").write_text(text.replace("cables: []", CABLES % given))
    robot = load_robot(tmp_path / "arm.yaml")
    rng = np.random.default_rng(0)
    for _ in range(10):
        angles = rng.uniform(-30.0, 30.0, 2)
        turned = robot.effective_radii[0] @ angles
        assert turned == pytest.approx(0.015 * (differential(angles)[0] - OFF[0]), abs=1e-15)


def test_drums_before_a_linkage_are_sums_of_its_joints(tmp_path, capsys):
    document, _ = begun(driven("j1", "j2") + ros2("FourBarLinkageTransmission"), tmp_path)
    assert [motor["name"] for motor in document["motors"]] == ["j1", "j2"]
    said = capsys.readouterr().out
    found = dict(re.findall(r"turns with (a\d) has motor: ({[^}]*})", said))
    assert load_yaml(found["a1"], "a1") == {"j1": 100.0}
    assert load_yaml(found["a2"], "a2") == {"j1": -40.0, "j2": -32.0}
    assert "j1 is a motor here: the links that it carries stand still with it" in said


def test_actuators_that_joints_follow_have_the_ranges_that_the_joints_allow(tmp_path):
    document, _ = begun(driven("a1", "a2") + ros2("DifferentialTransmission"), tmp_path)
    assert document["motors"] == []
    entries = {joint["name"]: joint for joint in document["joints"]}
    assert set(entries) == {"a1", "a2", "j1", "j2"}
    corners = [(one, two) for one in (-0.4, 0.5) for two in (-0.6, 0.3)]
    first = [AR[0] * (JR[0] * (one - OFF[0]) + JR[1] * (two - OFF[1])) for one, two in corners]
    assert entries["a1"]["range"] == pytest.approx([min(first), max(first)])
    assert entries["a1"]["max_speed"] == pytest.approx(2 * 50 * (2 * 2.0 + 0.8 * 3.0))


@pytest.mark.parametrize(
    ("kind", "joints_of"),
    [("DifferentialTransmission", differential), ("FourBarLinkageTransmission", four_bar)],
)
def test_joints_that_are_not_published_follow_the_actuators(kind, joints_of, tmp_path):
    _, text = begun(driven("a1", "a2") + ros2(kind), tmp_path)
    (tmp_path / "arm.yaml").write_text(
        text.replace("motors: []", "motors: [{name: m}]").replace("cables: []", CABLES % "m")
    )
    model = prepare(load_robot(tmp_path / "arm.yaml"), check_range=False)
    assert [joint.name for joint in model.robot.joints] == ["a1", "a2"]
    # the same arm, all of whose joints are measured, with the same reference pose
    rest = dict(zip(("j1", "j2"), joints_of(model.robot.reference_pose).tolist(), strict=True))
    own = "".join(
        f"\n  - {{name: {name}, range: [-9, 9], reference_angle: {angle!r}}}"
        for name, angle in rest.items()
    )
    plain = (tmp_path / "arm.yaml").read_text()
    plain = re.sub(r"\n  - {name: (a1|a2|j1|j2),.*", "", plain)
    plain = plain.replace("joints:\n", f"joints:{own}\n", 1)
    plain = re.sub(r"joints: \[[^]]*]}", "joints: [j1, j2]}", plain)
    (tmp_path / "plain.yaml").write_text(plain)
    other = prepare(load_robot(tmp_path / "plain.yaml"), check_range=False)
    assert [joint.name for joint in other.robot.joints] == ["j1", "j2"]
    t = 0.03 * np.arange(200)
    motion = model.robot.reference_pose + np.stack([9 * np.sin(t), 5 * np.sin(2.3 * t)], axis=1)
    for actuators in motion[::20]:
        one, two = shape_at(model, actuators), shape_at(other, joints_of(actuators))
        np.testing.assert_allclose(one.length, two.length, atol=1e-14)
    assert_same_tensions_and_work(model, other, joints_of, motion)


def test_without_ros2_control_joints_and_motors_are_those_of_the_transmissions(tmp_path, capsys):
    bare = (ARM % "").replace('<ros2_control name="s" type="system"></ros2_control>', PR2)
    (tmp_path / "arm.urdf").write_text(bare)
    out = tmp_path / "arm.yaml"
    assert import_robot.main([str(tmp_path / "arm.urdf"), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    document = load_yaml(out.read_text(), "arm")
    assert document["motors"] == [{"name": "a1"}, {"name": "a2"}]
    assert [joint["name"] for joint in document["joints"]] == ["j1", "j2"]
    assert "there is no ros2_control: motors and joints are those of the transmissions" in said
    (given,) = re.findall(r"turns with j1 has motor: ({[^}]*})", said)
    assert load_yaml(given, "j1") == {"a1": 0.005, "a2": 0.00625}


def test_a_transmission_whose_axes_are_not_published_is_named(tmp_path, capsys):
    begun(driven("a1") + measured("j1", "j2") + ros2("DifferentialTransmission"), tmp_path)
    said = capsys.readouterr().out
    assert "transmission t (DifferentialTransmission) couples j1, j2 to a1, a2" in said
    assert "a2 is not published: none of its reductions is in the file" in said


def test_transmissions_left_out_for_one_reason_share_a_line(tmp_path, capsys):
    both = ros2("ScrewTransmission") + ros2("ScrewTransmission").replace('"t"', '"u"')
    begun(driven("a1", "a2") + measured("j1", "j2") + both, tmp_path)
    (said,) = re.findall("note: .*ScrewTransmission is not known.*", capsys.readouterr().out)
    assert "t (ScrewTransmission) couples j1, j2 to a1, a2, u (ScrewTransmission) couples" in said
