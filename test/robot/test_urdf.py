"""Frames and joints from a URDF: links are frames, limits are ranges; mistakes in one line."""

import os
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.places import ROBOTS
from support.refusal import refusal

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import load_robot, parse_robot
from cdrj_ros.robot.urdf import parsed_urdf, urdf_element
from cdrj_ros.robot.writer import moved, with_numbers_in_text

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="world_link"/>
  <link name="upper"><visual><geometry><mesh filename="package://absent/m.stl"/></geometry></visual></link>
  <link name="lower"/> <link name="tip"/> <link name="aside"/> <link name="coupled"/> <link name="rail"/>
  <joint name="shoulder" type="revolute">
    <parent link="world_link"/> <child link="upper"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/> <axis xyz="0 1 1"/>
    <limit lower="-0.5" upper="0.9" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/> <child link="lower"/> <origin xyz="0.3 0 0"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="wrist" type="fixed">
    <parent link="lower"/> <child link="tip"/> <origin rpy="0 0 1.5"/>
  </joint>
  <joint name="follower" type="revolute">
    <parent link="lower"/> <child link="coupled"/> <axis xyz="1 0 0"/>
    <mimic joint="shoulder" multiplier="-0.5" offset="0.1"/> <limit lower="-1" upper="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="coupled"/> <child link="rail"/> <axis xyz="0 1 0"/>
    <limit lower="0.1" upper="0.2"/>
  </joint>
  <joint name="unused" type="revolute">
    <parent link="tip"/> <child link="aside"/> <limit lower="-1" upper="1"/>
  </joint>
</robot>
"""  # noqa: E501

ROBOT = """
name: arm
motors: []
joints: [{name: elbow, range: [-2, 2]}]
frames: {urdf: arm.urdf}
cables:
  - name: c
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: anchor, position: [0, 0, 0]}
      - {type: eyelet, position: [0.1, 0, 0.05], frame: upper}
      - {type: eyelet, position: [0.1, 0, 0.05], frame: rail}
      - {type: anchor, position: [0.1, 0.2, 0], frame: tip}
"""


def robot(folder, text=ROBOT, urdf=URDF):
    (folder / "arm.urdf").write_text(urdf)
    (folder / "arm.yaml").write_text(text)
    return load_robot(folder / "arm.yaml")


def test_links_become_frames_and_limits_ranges(tmp_path):
    found = robot(tmp_path)
    assert [joint.name for joint in found.joints] == ["elbow", "shoulder", "slide"]
    assert [(joint.lower, joint.upper) for joint in found.joints] == [
        (-2.0, 2.0), (-0.5, 0.9), (0.1, 0.2),
    ]  # fmt: skip
    assert found.joints[2].reference_angle == 0.1
    assert prepare(found).layout.force_frame == found.base_link == "world_link"
    stated = robot(tmp_path, f"base_link: arm/world\n{ROBOT}")
    assert prepare(stated).layout.in_frame("").base_link == "arm/world"
    frames = {frame.name: frame for frame in found.frames}
    assert "aside" not in frames  # no node is on it
    assert frames["coupled"].joint == "shoulder"
    assert found.prismatic_joints == {"slide"}


CHAIN = """<robot name="chain"> <link name="a"/> <link name="b"/> <link name="c"/> <link name="d"/>
  <joint name="one" type="revolute"> <parent link="a"/> <child link="b"/> <origin xyz="0.1 0 0"/>
    <axis xyz="0 0 1"/> <limit lower="-1" upper="1"/> </joint>
  <joint name="two" type="revolute"> <parent link="b"/> <child link="c"/> <axis xyz="0 1 2"/>
    <origin xyz="0.1 0 0" rpy="0.3 -0.2 0.1"/> <limit lower="-1" upper="1"/>TWO</joint>
  <joint name="three" type="TYPE"> <parent link="c"/> <child link="d"/> <axis xyz="1 0 1"/>
    <origin xyz="0 0.1 0" rpy="0 0.4 0"/> <limit lower="-1" upper="1"/>THREE</joint>
</robot>"""
MIMICS = {
    "TWO": '<mimic joint="one" multiplier="0.5" offset="0.1"/>',
    "THREE": '<mimic joint="two" multiplier="-0.4" offset="0.2"/>',
}
ON_CHAIN = """
name: chain
motors: []
friction: {mu_c: 0.2}
frames: {urdf: arm.urdf, joints: [JOINTS]}
cables:
  - {name: c, axial_stiffness: 1e4, preload: 10, nodes: [
      {type: anchor, position: [0, 0, 0.05]}, {type: eyelet, position: [0.1, 0, 0.05], frame: b},
      {type: anchor, position: [0.1, 0, 0.02], frame: d}]}
"""


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_chain_of_mimics_is_the_robot_whose_joints_stand_where_it_puts_them(kind, tmp_path):
    plain = CHAIN.replace("TYPE", kind)
    mimicking, measured = plain, plain.replace("TWO", "").replace("THREE", "")
    for key, tag in MIMICS.items():
        mimicking = mimicking.replace(key, tag)
    every = prepare(robot(tmp_path, ON_CHAIN.replace("JOINTS", "one, two, three"), measured))
    led = prepare(robot(tmp_path, ON_CHAIN.replace("JOINTS", "one"), mimicking))
    still = prepare(robot(tmp_path, ON_CHAIN.replace("JOINTS", ""), mimicking))
    share = np.array([1.0, 0.5, -0.2])
    for angle in (0.0, -0.7, 0.4):
        two = 0.5 * angle + 0.1
        expected = shape_at(every, np.array([angle, two, -0.4 * two + 0.2]))
        found = shape_at(led, np.array([angle]))
        np.testing.assert_allclose(found.length, expected.length, rtol=1e-12)
        np.testing.assert_allclose(found.lever_arm[:, 0], expected.lever_arm @ share, atol=1e-14)
        if angle == 0.0:
            length = shape_at(still, np.empty(0)).length
            np.testing.assert_allclose(length, expected.length, rtol=1e-12)


def test_a_ring_of_mimics_is_refused_by_name(tmp_path):
    ring = CHAIN.replace("TYPE", "revolute").replace("THREE", MIMICS["THREE"])
    ring = ring.replace("TWO", MIMICS["TWO"].replace("one", "three"))
    with pytest.raises(RobotFileError, match="joint 'two' mimics itself, through others"):
        robot(tmp_path, ON_CHAIN.replace("JOINTS", "one"), ring)


@pytest.mark.parametrize("of_urdf", [True, False])
def test_a_prefix_is_that_of_names_in_messages_and_where_it_has_it_of_the_urdf(of_urdf, tmp_path):
    plain = robot(tmp_path)
    text = f"prefix: arm1_\n{ROBOT}"
    text = text.replace("{urdf: arm.urdf}", "{urdf: arm.urdf, joints: [elbow, shoulder, slide]}")
    urdf = re.sub(r'(name|link|joint)="(?=[a-z])', r'\1="arm1_', URDF) if of_urdf else URDF
    # another robot in the same URDF, with the names of this one but for the prefix
    other = """<link name="tip"/><joint name="elbow" type="revolute"><parent link="arm1_tip"/>
        <child link="tip"/><limit lower="-1" upper="1"/></joint>"""
    found = robot(tmp_path, text, urdf.replace("</robot>", f"{other if of_urdf else ''}</robot>"))
    assert [one.name for one in found.joints] == ["arm1_elbow", "arm1_shoulder", "arm1_slide"]
    assert found.base_link == ("arm1_world_link" if of_urdf else "world_link")
    pose = np.array([0.3, -0.2, 0.15])
    np.testing.assert_array_equal(
        shape_at(prepare(found, check_range=False), pose).length,
        shape_at(prepare(plain, check_range=False), pose).length,
    )


def test_lengths_are_those_of_the_chain_of_transformations(tmp_path):
    model = prepare(robot(tmp_path), check_range=False)
    generator = np.random.default_rng(0)
    for elbow, shoulder, slide in generator.uniform([-2, -0.5, 0.1], [2, 0.9, 0.2], (50, 3)):
        axis = np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)
        upper = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]) * Rotation.from_rotvec(shoulder * axis)
        at_upper = np.array([0.1, 0.2, 0.3])
        lower = upper * Rotation.from_rotvec([0, 0, elbow])
        at_lower = at_upper + upper.apply([0.3, 0, 0])
        coupled = lower * Rotation.from_rotvec([-0.5 * shoulder + 0.1, 0, 0])
        tip = lower * Rotation.from_rotvec([0, 0, 1.5])
        points = np.array(
            [
                np.zeros(3),
                at_upper + upper.apply([0.1, 0, 0.05]),
                at_lower + coupled.apply([0.1, slide, 0.05]),
                at_lower + tip.apply([0.1, 0.2, 0]),
            ]
        )
        found = shape_at(model, np.array([elbow, shoulder, slide]))
        expected = np.linalg.norm(np.diff(points, axis=0), axis=1)
        np.testing.assert_allclose(found.length, expected, atol=1e-14)


def test_joints_that_are_not_listed_stand_still(tmp_path):
    text = ROBOT.replace("{urdf: arm.urdf}", "{urdf: arm.urdf, joints: [elbow]}")
    found = robot(tmp_path, text)
    assert [joint.name for joint in found.joints] == ["elbow"]
    assert {f.motion for f in found.frames if f.joint is None} == {"fixed"}


def test_a_package_is_found_through_the_ament_index(tmp_path, monkeypatch):
    share = tmp_path / "install" / "share" / "arm_description" / "urdf"
    share.mkdir(parents=True)
    (share / "arm.urdf").write_text(URDF)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'install'}")
    text = ROBOT.replace("arm.urdf", "package://arm_description/urdf/arm.urdf")
    (tmp_path / "arm.yaml").write_text(text)
    assert len(load_robot(tmp_path / "arm.yaml").joints) == 3
    (tmp_path / "arm.yaml").write_text(text.replace("arm_description", "absent"))
    with pytest.raises(RobotFileError, match="below AMENT_PREFIX_PATH; is the workspace sourced"):
        load_robot(tmp_path / "arm.yaml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "latin-1", "utf-8-sig"])
def test_a_document_type_is_refused_in_every_encoding(encoding, tmp_path):
    declared = "utf-16" if "16" in encoding else encoding.removesuffix("-sig")
    entities = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    xml = f'<?xml version="1.0" encoding="{declared}"?>{entities}<robot name="&b;"/>'
    with pytest.raises(RobotFileError, match="declares a document type"):
        parsed_urdf(xml.encode(encoding), tmp_path / "arm.urdf")


def test_only_a_regular_file_of_bounded_size_is_read(tmp_path):
    pipe, large = tmp_path / "pipe", tmp_path / "large"
    os.mkfifo(pipe)
    with large.open("wb") as file:
        file.truncate(10**12)  # without blocks on the disk
    for path, words in ((pipe, "not a regular file"), (large, "000 bytes, at most")):
        with pytest.raises(RobotFileError, match=words):
            urdf_element(path, "arm.yaml")


MISTAKES = {
    "loop": ('<child link="upper"/>', '<child link="tip"/>', "is the child of two joints"),
    "ring": ('<parent link="world_link"/>', '<parent link="tip"/>', "joints form a loop"),
    "two names": ('name="elbow"', 'name="shoulder"', "has two joints of the name 'shoulder'"),
    "no link": ('<child link="tip"/>', '<child link="top"/>', "names no link: 'top'"),
    "axis": ("0 1 1", "0 0 0", "joint 'shoulder': its axis must be a direction"),
    "numbers": ('xyz="0.3 0 0"', 'xyz="0.3 0"', "joint 'elbow', xyz must have 3 numbers"),
    "type": ('type="prismatic"', 'type="spherical"', "must be one of fixed, revolute, continuous"),
    "no limits": ("", "", "joints: elbow has no limits in the URDF; list it with its range"),
    "entity": ("<robot ", "<!DOCTYPE x><robot ", "declares a document type"),
    "encoding": ('<?xml version="1.0"?>', '<?xml version="1.0" encoding="x-none"?>', "is no XML"),
    "no XML": ("</robot>", "", "is no XML"),
    "xacro": ('<link name="tip"/>', '<link name="tip"/><xacro/>', "is a xacro file"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_the_urdf_is_one_clear_line(name, tmp_path):
    right, wrong, message = MISTAKES[name]
    text = ROBOT.replace("[{name: elbow, range: [-2, 2]}]", "[]") if name == "no limits" else ROBOT
    assert right in URDF
    urdf = URDF.replace(right, wrong, 1) if right else URDF
    assert message in refusal(robot, tmp_path, text, urdf)


def test_a_listed_joint_that_the_urdf_lacks_is_named_with_those_that_it_has(tmp_path):
    text = ROBOT.replace("{name: elbow, range: [-2, 2]}", "{name: knee}")
    with pytest.raises(RobotFileError, match="no joint 'knee'; its moving joints are elbow, fol"):
        robot(tmp_path, text)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ("{urdf: absent.urdf}", "cannot read"),
        ("{file: arm.urdf}", "frames must be a list, or a mapping with urdf"),
        ("{urdf: arm.urdf, joints: [knee]}", "has no moving joint 'knee'; it has elbow, follower"),
        ("{urdf: arm.urdf, joints: [follower]}", "follower mimics shoulder in arm.urdf"),
        ("{urdf: arm.urdf, joints: elbow}", "frames.joints must be a list of names"),
    ],
)
def test_a_mistake_in_the_frames_is_one_clear_line(frames, message, tmp_path):
    assert message in refusal(robot, tmp_path, ROBOT.replace("{urdf: arm.urdf}", frames))


def test_a_file_that_moves_to_another_folder_finds_its_urdf(tmp_path):
    here, there = tmp_path / "here", tmp_path / "far" / "there"
    for folder in (here, there):
        folder.mkdir(parents=True)
    before = robot(here)
    text = moved(ROBOT, str(here / "arm.yaml"), str(there / "arm.yaml"))
    (there / "arm.yaml").write_text(text)
    assert load_robot(there / "arm.yaml").frames == before.frames
    assert moved(ROBOT, str(here / "arm.yaml"), str(here / "other.yaml")) == ROBOT


@pytest.mark.parametrize(
    "listed",
    [
        "[]",
        "[{name: pip, noise: 1.0e-4}]",
        "\n  - name: pip\n    noise: 1.0e-4   # counts\n  - {name: mcp}\n",
    ],
)
def test_numbers_of_joints_that_only_the_urdf_lists_can_be_written(listed):
    path = ROBOTS / "finger3d.yaml"
    text = path.read_text().replace("joints: []", f"joints: {listed}")
    values = {"joints.abduction.reference_angle": 0.01, "joints.pip.reference_angle": 0.02}
    written = with_numbers_in_text(text, values, str(path))
    joints = parse_robot(written, str(path)).joints
    found = {joint.name: joint for joint in joints}
    assert [*found] == [joint.name for joint in parse_robot(text, str(path)).joints]
    assert found["abduction"].reference_angle == 0.01
    assert found["pip"].reference_angle == 0.02
    assert found["mcp"].reference_angle == 0.0
    assert (found["pip"].sensor.noise == 1e-4) == ("noise" in listed)
    assert written.count("#") == text.count("#")


def test_a_number_of_the_urdf_itself_is_not_written():
    path = ROBOTS / "finger3d.yaml"
    with pytest.raises(RobotFileError, match=r"^frames\.palm\.origin\.2 is a number of the URDF"):
        with_numbers_in_text(path.read_text(), {"frames.palm.origin.2": 0.001}, str(path))


@pytest.mark.parametrize(
    "urdf", ["robot_description", "package://arm/arm.urdf", "/opt/arm/arm.urdf"]
)
def test_a_place_that_no_folder_changes_is_kept(urdf):
    text = ROBOT.replace("arm.urdf", urdf)
    assert moved(text, "/here/arm.yaml", "/there/arm.yaml") == text
