"""Shapes of bodies: from a URDF or the robot file to points in the base, in every pose."""

import re
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.refusal import refusal

from cdrj_ros.model.prepared import prepare
from cdrj_ros.report.scene import mesh_in, scene_of
from cdrj_ros.robot.reader import load_robot, parse_robot

URDF = """<robot name="arm"> <link name="base_link"><visual>
  <geometry><cylinder radius="0.02" length="0.1"/></geometry></visual></link>
<link name="upper"><visual><origin xyz="0.1 0 0.05" rpy="0.4 0.5 0.6"/>
  <geometry><box size="0.2 0.03 0.04"/></geometry></visual></link>
<link name="cover">
  <visual><geometry><mesh filename="part.stl" scale="0.5 0.5 0.5"/></geometry></visual>
  <visual><geometry><mesh filename="package://absent/no.stl"/></geometry></visual>
  <visual><geometry><mesh filename="../../../../../etc/passwd"/></geometry></visual>
  <visual><geometry><sphere radius="many"/></geometry></visual></link>
<joint name="shoulder" type="revolute"><parent link="base_link"/><child link="upper"/>
  <origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>
<joint name="screwed" type="fixed"><parent link="upper"/><child link="cover"/>
  <origin xyz="0.2 0 0" rpy="0 0 1.5707963267948966"/></joint>
</robot>"""
ROBOT = """
name: arm
motors: []
joints: []
frames: {urdf: arm.urdf}
cables:
  - name: c
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: anchor, position: [0.3, 0, 0]}
      - {type: anchor, position: [0.1, 0.05, 0], frame: upper}
"""
TRIANGLE = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.04, 0.0]])


@pytest.fixture
def model(tmp_path):
    corners = struct.pack("<12f", 0.0, 0.0, 1.0, *TRIANGLE.ravel())
    (tmp_path / "part.stl").write_bytes(bytes(80) + struct.pack("<I", 1) + corners + bytes(2))
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "arm.yaml").write_text(ROBOT)
    return prepare(load_robot(tmp_path / "arm.yaml"))


def test_the_shapes_of_a_urdf_move_with_its_links(model):
    assert [one.shape for one in model.robot.visuals] == ["cylinder", "box", "mesh"]
    for angle in (-0.7, 0.0, 0.9):
        cylinder, box, part = scene_of(model, np.array([angle])).visuals
        np.testing.assert_allclose(cylinder.points[:, 2], np.repeat([-0.05, 0.05], 32))
        link = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]) * Rotation.from_rotvec([0, angle, 0])
        own = Rotation.from_euler("xyz", [0.4, 0.5, 0.6])
        at, middle = np.array([0.0, 0.0, 0.2]), np.array([0.1, 0.0, 0.05])
        expected = at + link.apply(middle + own.apply([0.1, 0.015, -0.02]))
        assert np.linalg.norm(box.points - expected, axis=1).min() < 1e-12
        turned = Rotation.from_quat(np.roll(box.quaternion, -1)).as_matrix()
        np.testing.assert_allclose(turned, (link * own).as_matrix(), atol=1e-12)
        if mesh_in(part.mesh) is None:
            pytest.skip("trimesh is not installed")
        yaw = Rotation.from_rotvec([0, 0, np.pi / 2])
        tip = at + link.apply(np.array([0.2, 0.0, 0.0]) + yaw.apply([0, 0.02, 0]))  # half of 0.04
        assert np.linalg.norm(part.points - tip, axis=1).min() < 1e-7


def test_a_robot_file_may_have_shapes_of_its_own(tmp_path):
    text = ROBOT.replace("frames: {urdf: arm.urdf}", """
frames: [{name: upper, motion: revolute, joint: q, origin: [0, 0, 0.2]}]
visuals:
  - {frame: upper, box_mm: [200, 30, 40], origin_mm: [100, 0, 0]}
  - {sphere_mm: 20}
""").replace("joints: []", "joints: [{name: q, range: [-1, 1]}]")  # fmt: skip
    box, sphere = scene_of(prepare(parse_robot(text)), np.zeros(1)).visuals
    np.testing.assert_allclose([box.points.min(axis=0), box.points.max(axis=0)],
                               [[0, -0.015, 0.18], [0.2, 0.015, 0.22]])  # fmt: skip
    np.testing.assert_allclose(np.linalg.norm(sphere.points, axis=1), 0.02)
    for wrong, words in (
        ("{frame: hand, sphere: 1}", "visuals[0].frame must be one of base, upper, got 'hand'"),
        ("{frame: upper}", "visuals[0] needs one of box, cylinder, sphere, mesh, got (none)"),
        ("{box: [1, 1, 1], sphere: 1}", "visuals[0] needs one of box"),
    ):
        changed = text.replace("  - {sphere_mm: 20}\n", "")
        changed = re.sub(r"\{frame: upper, box_mm.*\}", wrong, changed)
        assert refusal(parse_robot, changed).startswith(words)


@pytest.mark.parametrize("kind", ["text", "huge", "folder", "other"])
def test_a_file_that_is_no_mesh_is_left_out(kind, tmp_path):
    path = tmp_path / ("a.stl" if kind != "other" else "a.yaml")
    if kind == "folder":
        path.mkdir()
    elif kind == "huge":
        with path.open("wb") as file:
            file.truncate(10**12)
    else:
        path.write_text("solid nothing")
    assert mesh_in(str(path)) is None
