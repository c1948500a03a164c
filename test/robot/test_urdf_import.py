"""A robot file begun from a URDF with ros2_control: names, gears, limits, and what is open."""

import re

import numpy as np
import pytest

from cdrj_ros.commands import import_robot
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.output import said_once
from cdrj_ros.foundation.yaml import load_yaml
from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.inspection.suspicions import find_suspicions
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import load_robot, parse_robot

STATE = '<state_interface name="position"/><state_interface name="velocity"/>'
COMMAND = '<command_interface name="effort"/>'


def link(name, parent, joint, kind, limit=""):
    return (
        f'<link name="{name}"/><joint name="{joint}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}"/><axis xyz="0 0 1"/>{limit}</joint>'
    )


URDF = f"""<robot name="2-joint arm"><link name="base_link"/>
{
    link(
        "drum",
        "base_link",
        "winch/1",
        "continuous",
        '<origin xyz="-0.03 0 0.02"/><limit effort="2" velocity="30"/>',
    )
}
{
    link(
        "upper",
        "base_link",
        "shoulder",
        "revolute",
        '<limit lower="-0.5" upper="0.9" effort="1" velocity="4"/>',
    )
}
{link("lower", "upper", "el-bow", "continuous")}
{link("gripper", "lower", "claw", "revolute", '<limit lower="0" upper="1"/>')}
<ros2_control name="arm" type="system">
  <hardware><plugin>arm_hardware/System</plugin></hardware>
  <joint name="winch/1">{COMMAND}{STATE}</joint>
  <joint name="m2">{COMMAND}{STATE}</joint>
  <joint name="shoulder">{STATE}</joint> <joint name="el-bow">{STATE}</joint>
  <transmission name="t1"><plugin>transmission_interface/SimpleTransmission</plugin>
    <actuator name="m1" role="actuator1"/>
    <joint name="winch/1" role="joint1"><mechanical_reduction>50</mechanical_reduction></joint>
  </transmission>
  <transmission name="t2"><plugin>transmission_interface/SimpleTransmission</plugin>
    <actuator name="m2" role="actuator1"/>
    <joint name="drum_2" role="joint1"><mechanical_reduction>-20</mechanical_reduction>
      <offset>0.4</offset></joint>
  </transmission>
</ros2_control></robot>"""


def begun(folder, urdf=URDF):
    (folder / "description").mkdir()
    (folder / "description" / "arm.urdf").write_text(urdf)
    out = folder / "arm.yaml"
    assert import_robot.main([str(folder / "description" / "arm.urdf"), "--out", str(out)]) == 0
    return out.read_text()


def with_a_cable(text):
    """The file with a cable from the first motor to the last link."""
    motor = re.findall(r"  - {name: ([^,}]+)", text)[0]
    return text.replace(
        "cables: []",
        f"""cables:
  - name: cable_1
    axial_stiffness: 60000
    preload: 20
    nodes:
      - {{type: winch, motor: {motor}, winding: 1, radius_mm: 15, frame: base_link,
         position_mm: [0, 0, 0], axis: [0, 0, 1], turn: cw}}
      - {{type: anchor, frame: gripper, position_mm: [50, 50, 50]}}
""",
    )


def test_names_gears_and_limits_are_those_of_the_urdf(tmp_path, capsys):
    text = begun(tmp_path)
    said = capsys.readouterr().out
    (tmp_path / "arm.yaml").write_text(with_a_cable(text))
    robot = load_robot(tmp_path / "arm.yaml")
    assert robot.name == "robot_2_joint_arm"
    assert robot.base_link == "base_link"
    assert "# base_link, upper, lower, gripper" in text
    first, second = robot.motors
    assert (first.name, first.sensor.scale, first.effort_scale) == ("winch/1", 1.0, 1.0)
    assert first.max_speed == 60.0
    assert (second.name, second.sensor.scale, second.sensor.offset) == ("m2", -0.05, 0.4)
    assert second.effort_scale == -20.0
    ranges = {joint.name: (joint.lower, joint.upper) for joint in robot.joints}
    assert ranges["shoulder"] == (-0.5, 0.9)
    assert ranges["el-bow"] == pytest.approx((-3.14159265, 3.14159265))
    assert {joint.name: joint.max_speed for joint in robot.joints}["shoulder"] == 8.0
    assert "winch/1 is published behind its transmission of 50" in said
    assert "if the hardware publishes the actuator itself, scale: 0.02 and effort_scale: 50" in said
    assert "claw is not in ros2_control: it stands at 0" in said
    assert "el-bow has no limits: a range of one turn is assumed" in said
    assert "is begun; add its cables" in said
    guesses = ["friction.mu_c", "joints.el-bow.range.1", "joints.el-bow.range.2"]
    assert robot.document["assumed"] == guesses
    model = prepare(robot, check_range=False)
    (found,) = (one for one in find_suspicions(inspect_robot(model)) if one.where == "assumed")
    assert found.text.startswith(", ".join(guesses))


def test_transmissions_alone_name_the_motors(tmp_path):
    old = URDF.replace("<ros2_control", "<gazebo").replace("</ros2_control", "</gazebo")
    (tmp_path / "arm.yaml").write_text(with_a_cable(begun(tmp_path, old)))
    robot = load_robot(tmp_path / "arm.yaml")
    assert [motor.name for motor in robot.motors] == ["winch/1", "drum_2"]
    assert {joint.name for joint in robot.joints} == {"shoulder", "el-bow", "claw"}


def test_mjcf_without_mujoco_is_answered_with_the_cause_and_what_to_install(
    tmp_path, monkeypatch, capsys
):
    """It may be there, but without one of its parts."""
    (tmp_path / "mujoco.py").write_text("raise ImportError('no libGL')")
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    monkeypatch.syspath_prepend(str(tmp_path))
    given = [str(tmp_path / "arm.xml"), "--out", str(tmp_path / "arm.yaml")]
    assert import_robot.main(given) == 2
    assert "the package mujoco (no libGL): pip install mujoco" in capsys.readouterr().err


def test_the_file_is_refused_until_it_has_a_cable(tmp_path):
    text = begun(tmp_path)
    with pytest.raises(RobotFileError, match="cables needs at least 1 entries, got 0"):
        parse_robot(text, str(tmp_path / "arm.yaml"))


LINKED = """
<robot name="wrist">
  <link name="world"/><link name="fore"/><link name="slider"/><link name="yoke"/><link name="hand"/>
  <joint name="float" type="floating"><parent link="world"/><child link="fore"/></joint>
  <joint name="table" type="planar"><parent link="fore"/><child link="slider"/></joint>
  <joint name="pitch" type="revolute"><parent link="slider"/><child link="yoke"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="2"/></joint>
  <joint name="roll" type="revolute"><parent link="yoke"/><child link="hand"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="2"/></joint>
  <ros2_control name="s" type="system">
    <joint name="left"><command_interface name="effort"/><state_interface name="position"/></joint>
    <joint name="right"><command_interface name="effort"/><state_interface name="position"/></joint>
    <joint name="pitch"><state_interface name="position"/></joint>
    <joint name="roll"><state_interface name="position"/></joint>
    <transmission name="d"><plugin>transmission_interface/DifferentialTransmission</plugin>
      <actuator name="left" role="actuator1"><mechanical_reduction>30</mechanical_reduction></actuator>
      <actuator name="right" role="actuator2"><mechanical_reduction>-30</mechanical_reduction></actuator>
      <joint name="pitch" role="joint1"><mechanical_reduction>2</mechanical_reduction>
        <offset>0.1</offset></joint>
      <joint name="roll" role="joint2"><mechanical_reduction>2</mechanical_reduction></joint>
    </transmission>
  </ros2_control>
</robot>
"""  # noqa: E501


def imported_document(text, folder):
    source, out = folder / "wrist.urdf", folder / "wrist.yaml"
    source.write_text(text)
    assert import_robot.main([str(source), "--out", str(out)]) == 0
    return load_yaml(out.read_text(), str(out))


def test_floating_and_planar_joints_are_held_and_named(tmp_path, capsys):
    imported_document(LINKED, tmp_path)
    said = capsys.readouterr().out
    held = "is a floating or planar joint: it is held at its place in the model"
    assert f"each of float, table {held}" in said


@pytest.mark.parametrize("limit", ["", '<limit effort="1"/>', '<limit lower="1" upper="-1"/>'])
@pytest.mark.parametrize(("kind", "words"), [("revolute", "one turn"), ("prismatic", "2 m")])
def test_limits_that_are_none_are_assumed_and_named(kind, words, limit, tmp_path, capsys):
    text = (
        '<robot name="r"><link name="a"/><link name="b"/>'
        f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{limit}</joint></robot>'
    )
    document = imported_document(text, tmp_path)
    assert document["joints"][0]["range"] == (
        pytest.approx([-np.pi, np.pi]) if kind == "revolute" else [-1.0, 1.0]
    )
    assert document["assumed"] == ["friction.mu_c", "joints.j.range.1", "joints.j.range.2"]
    assert f"j has no limits: a range of {words} is assumed" in capsys.readouterr().out


UNREADABLE = {
    "number.urdf": (URDF.replace(">50<", ">fifty<"), "must be a number, got 'fifty'"),
    "link.urdf": (
        URDF.replace('<child link="upper"/>', '<child link="up"/>'),
        "names no link: 'up'",
    ),
    "spare.urdf": (
        LINKED.replace('<link name="world"/>', '<link name="world"/><link name="spare"/>'),
        "must have one root link, got 2: world, spare; a link that is the child of no joint",
    ),
    "arm.urdf.xacro": (LINKED, "arm.urdf.xacro -o arm.urdf"),
    "arm.xacro.urdf": (LINKED.replace("<link", "<xacro/><link", 1), "arm.xacro.urdf -o arm.urdf"),
    "arm.urdf": (
        LINKED.replace("<link", "<xacro/><link", 1),
        "arm.urdf -o arm.expanded.urdf",
    ),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_a_model_that_cannot_be_begun_names_what_to_do(name, tmp_path, capsys):
    text, message = UNREADABLE[name]
    (tmp_path / name).write_text(text)
    out = tmp_path / "out.yaml"
    assert import_robot.main([str(tmp_path / name), "--out", str(out)]) == 2
    assert not out.exists()
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1


def test_remarks_of_one_kind_are_said_once_with_all_names():
    remarks = ["a is left out: b", "c is left out: b", "d: doubled", "e: doubled", "one more"]
    assert said_once(remarks) == ["each of a, c is left out: b", "d, e: doubled", "one more"]


def test_a_prefix_that_all_names_share_is_offered(tmp_path, capsys):
    text = URDF
    for name in ("winch/1", "m1", "m2", "shoulder", "el-bow", "claw"):
        text = text.replace(f'"{name}"', f'"left_{name}"')
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    out = str(tmp_path / "arm.yaml")
    assert import_robot.main([str(tmp_path / "arm.urdf"), "--out", out]) == 0
    assert "begin with left_: prefix: left_ says it once" in capsys.readouterr().out
