"""Imported tendons have MuJoCo's lengths and moment arms, in 1000 random poses of every model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.commands import import_robot
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.reader import load_robot

mujoco = pytest.importorskip("mujoco", reason="the test extra mujoco is not installed")

POSES = 1000

SITES = """
<mujoco model="sites">
  <worldbody>
    <site name="a" pos="0 0 1"/>
    <body name="upper" pos="0.1 0 1" euler="10 20 30">
      <joint name="shoulder pitch" axis="0 1 0.2" range="-80 80" pos="0.01 0.02 0.03"/>
      <joint name="shoulder_roll" axis="1 0 0" range="-40 40" ref="10"/>
      <geom size="0.01"/>
      <site name="b" pos="0.2 0.03 0"/>
      <body pos="0.3 0 0">
        <joint name="slide" type="slide" axis="1 1 0" range="-0.1 0.2"/>
        <geom size="0.01"/>
        <site name="c" pos="0.1 0.05 0.02"/>
        <body name="fixed" pos="0.1 0 0" quat="0.5 0.5 -0.5 0.5">
          <geom size="0.01"/>
          <site name="d" pos="0.1 0.05 0.02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="abcd" stiffness="100"><site site="a"/><site site="b"/><site site="c"/><site site="d"/></spatial>
    <spatial name="branched">
      <site site="a"/><site site="b"/><pulley divisor="2"/><site site="b"/><site site="c"/>
      <pulley divisor="2"/><site site="b"/><site site="d"/>
    </spatial>
  </tendon>
</mujoco>
"""  # noqa: E501


def wrapped(geoms: str, tendon: str, body: str = "") -> str:
    return f"""
<mujoco model="wrapped">
  <worldbody>
    <site name="a" pos="-0.25 0.02 0.03"/>
    <geom name="still" type="cylinder" size="0.05 0.2" pos="-0.1 -0.01 0" euler="5 10 0"/>
    <site name="still_side" pos="-0.1 0.15 0"/>
    <site name="between" pos="-0.02 0.06 0.02"/>
    {geoms}
    <body name="arm" pos="0.1 0 0">
      <joint name="yaw" axis="0 0 1" range="-70 70"/>
      <joint name="pitch" axis="0 1 0.3" range="-50 50"/>
      <geom size="0.01" pos="0.2 0 0"/>
      {body}
      <site name="end" pos="0.25 0.03 0.02"/>
    </body>
  </worldbody>
  <tendon><spatial name="t"><site site="a"/>{tendon}<site site="end"/></spatial></tendon>
</mujoco>
"""


SPHERE = '<geom name="g" size="0.05" pos="0.1 0 0"/><site name="s" pos="0.1 0.12 0.02"/>'
CYLINDER = (
    '<geom name="g" type="cylinder" size="0.05 0.1" pos="0.1 0 0" euler="10 5 0"/>'
    '<site name="s" pos="0.1 0.12 0.02"/>'
)
CARRIED = (
    '<geom name="g" type="cylinder" size="0.04 0.1" pos="0.1 0 0" euler="10 5 0"/>'
    '<site name="s" pos="0.1 0.12 0.02"/>'
)
MODELS = {
    "sites": SITES,
    "sphere": wrapped(SPHERE, '<geom geom="g"/>'),
    "sphere with a side": wrapped(SPHERE, '<geom geom="g" sidesite="s"/>'),
    "cylinder": wrapped(CYLINDER, '<geom geom="g"/>'),
    "cylinder with a side": wrapped(CYLINDER, '<geom geom="g" sidesite="s"/>'),
    "cylinder on the arm": wrapped("", '<geom geom="g" sidesite="s"/>', CARRIED),
    "two bodies": wrapped(
        SPHERE, '<geom geom="still" sidesite="still_side"/><site site="between"/><geom geom="g"/>'
    ),
}


def imported(xml: str, folder: Path, *more: str) -> Model:
    """The model as a robot, through the command."""
    source, out = folder / "model.xml", folder / "robot.yaml"
    source.write_text(xml)
    assert import_robot.main([str(source), "--out", str(out), *more]) == 0
    return prepare(load_robot(out), check_range=False)


def moment_arms(model: object, data: object) -> np.ndarray:
    """MuJoCo's dense matrix of d length / d velocity, shape (tendons, velocities)."""
    values = np.asarray(data.ten_J)
    if values.size == model.ntendon * model.nv:
        return values.reshape(model.ntendon, model.nv)
    dense = np.zeros((model.ntendon, model.nv))
    counts, starts = data.ten_J_rownnz, data.ten_J_rowadr
    columns = np.ravel(data.ten_J_colind)
    for row in range(model.ntendon):
        part = slice(starts[row], starts[row] + counts[row])
        dense[row, columns[part]] = np.ravel(values)[part]
    return dense


@pytest.mark.parametrize("name", MODELS)
def test_lengths_and_moment_arms_are_those_of_mujoco(name: str, tmp_path: Path) -> None:
    robot = imported(MODELS[name], tmp_path)
    model = mujoco.MjModel.from_xml_string(MODELS[name])
    data = mujoco.MjData(model)
    generator = np.random.default_rng(0)
    low, high = model.jnt_range.T
    addresses = [
        model.jnt_qposadr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)]
        for joint in (label.replace("_pitch", " pitch") if "shoulder" in label else label
                      for label in robot.layout.joints)
    ]  # fmt: skip
    touched = 0
    for pose in low + generator.random((POSES, low.size)) * (high - low):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        shape = shape_at(robot, pose[addresses])
        lengths, arms = per_tendon(robot, shape.length), per_tendon(robot, shape.lever_arm)
        assert lengths == pytest.approx(data.ten_length, abs=1e-9)
        assert arms == pytest.approx(moment_arms(model, data)[:, addresses], abs=1e-7)
        touched += bool(np.any(shape.wrap > 0.0))
    assert touched > 50


def per_tendon(robot: Model, values: np.ndarray) -> np.ndarray:
    """Sums over the elements of every cable; the branches of one tendon, divided and summed."""
    first, sums = 0, []
    for cable in robot.robot.cables:
        sums.append(values[first : first + len(cable.nodes) - 1].sum(axis=0))
        first += len(cable.nodes) - 1
    if len(sums) == 4:  # abcd and three branches, the last two with the divisor 2
        sums = [sums[0], sums[1] + 0.5 * (sums[2] + sums[3])]
    return np.array(sums)


def test_what_cannot_be_represented_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SITES.replace(
        "</tendon>",
        '<fixed name="sum"><joint joint="slide" coef="1"/></fixed>'
        '<spatial name="inner" frictionloss="2"><site site="a"/><geom geom="ring" sidesite="in"/>'
        '<site site="b"/></spatial>'
        '<spatial name="tossed"><site site="a"/><site site="e"/></spatial></tendon>',
    )
    text = text.replace(
        '<site name="a"',
        '<geom name="ring" type="cylinder" size="0.3 0.1"/><site name="in" pos="0 0.1 0"/>'
        '<body name="loose"><joint type="ball" name="socket"/><geom size="0.1"/>'
        '<site name="e"/></body><site name="a"',
    )
    robot = imported(text, tmp_path)
    assert [cable.name for cable in robot.robot.cables] == [
        "abcd", "branched_1", "branched_2", "branched_3", "inner",
    ]  # fmt: skip
    said = capsys.readouterr().out
    for remark in (
        "sum is a fixed tendon",
        "tossed is left out: it depends on the ball joint socket",
        "branched_2: MuJoCo divides the length of this branch by 2",
        "EA of abcd is its stiffness 100 N/m times its length at qpos0",
        "frictionloss of inner is not carried over",
        "the joint shoulder pitch is called shoulder_pitch here",
    ):
        assert remark in said
    written = (tmp_path / "robot.yaml").read_text()
    assert written.count("# assumed") == 11
    assert "inside: true" in written
    assert "tossed is left out" in written


MISTAKES = {
    "absent.xml": (None, "there is no model"),
    "model.txt": ("x", "MODEL must be an MJCF file named .xml, or a URDF named .urdf"),
    "loop.urdf": ("<robot/>", "must have one root link"),
    "broken.xml": ("<mujoco", "cannot read"),
    "empty.xml": ("<mujoco/>", "has no spatial tendon that can become a cable"),
    "far.xml": (SITES.replace('pos="0.1 0 1"', 'pos="1e300 0 1"'), "must be finite and at most"),
    "nan.xml": (
        wrapped(SPHERE.replace("0.1 0 0", "nan 0 0"), '<geom geom="g"/>'),
        "position or size of geom 'g' must be finite and at most 1e+06 m, got [nan, ",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_wrong_model_is_one_clear_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text, message = MISTAKES[name]
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / name).write_text(text)
    out = tmp_path / "robot.yaml"
    assert import_robot.main([str(tmp_path / name), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not out.exists()
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_only_the_tendons_asked_for_are_imported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = imported(SITES, tmp_path, "--tendons", "abcd")
    assert [cable.name for cable in robot.robot.cables] == ["abcd"]
    arguments = [str(tmp_path / "model.xml"), "--tendons", "x", "--out", str(tmp_path / "o.yaml")]
    assert import_robot.main(arguments) == 2
    assert "there is no tendon x; the model has abcd, branched" in capsys.readouterr().err
