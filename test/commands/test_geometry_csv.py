"""check_robot --poses --geometry-csv: any robot's lengths, arms and wraps in given poses."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.commands import check_robot
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import shape_at

ROBOTS = sorted(
    path.stem for path in (Path(__file__).parents[2] / "config" / "robots").glob("*.yaml")
)


def table(path: Path) -> tuple[list[str], np.ndarray]:
    header, *lines = csv.reader(path.read_text().splitlines())
    return header, np.array(lines, dtype=float)


@pytest.fixture
def no_shares(monkeypatch: pytest.MonkeyPatch) -> None:
    """check_robot does not say what causes the uncertainty, which takes most of its time."""
    monkeypatch.setattr(check_robot, "uncertainty_shares", lambda _: None)


@pytest.mark.usefixtures("no_shares")
@pytest.mark.parametrize("robot", ROBOTS)
def test_lengths_arms_and_wraps_of_every_robot(robot: str, tmp_path: Path) -> None:
    model = load_model(robot)
    joints = model.robot.joints
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    middle = lower + np.random.default_rng(0).uniform(0.3, 0.7, (4, len(joints))) * (upper - lower)
    step = 1e-6
    poses = [
        pose + s * e for pose in middle for e in (*np.eye(len(joints)),) for s in (0, step, -step)
    ]
    given, out = tmp_path / "poses.csv", tmp_path / "out.csv"
    names = [joint.name for joint in joints][::-1]  # in any order, with motors between
    motors = [motor.name for motor in model.robot.motors]
    lines = [",".join([*names, *motors])]
    lines += [",".join(map(repr, [*map(float, p[::-1]), *[0.0] * len(motors)])) for p in poses]
    given.write_text("\n".join(lines) + "\n")
    assert check_robot.main([robot, "--poses", str(given), "--geometry-csv", str(out)]) == 0
    header, values = table(out)
    assert header == [
        *(f"length/{cable}" for cable in model.layout.cables),
        *(f"arm/{cable}/{joint.name}" for cable in model.layout.cables for joint in joints),
        *(f"wrap/{pulley}" for pulley in model.layout.pulleys),
    ]
    assert values.shape == (len(poses), len(header))
    for row, pose in zip(values, poses, strict=True):
        assert np.array_equal(
            row[len(row) - len(model.layout.pulleys) :], shape_at(model, pose).wrap
        )
    by_pose = values.reshape(len(middle), len(joints), 3, -1)
    for c, cable in enumerate(model.layout.cables):
        for j, joint in enumerate(joints):
            column = header.index(f"arm/{cable}/{joint.name}")
            difference = (by_pose[:, j, 1, c] - by_pose[:, j, 2, c]) / (2.0 * step)
            assert by_pose[:, j, 0, column] == pytest.approx(difference, abs=1e-8)


PLAIN = """\
name: plain
motors: [{name: m}]
joints: [{name: q, range: [-0.5, 0.5]}]
cables:
  - name: a
    axial_stiffness: 1e4
    preload: 20
    nodes:
      - {type: anchor, position: [0, 0, 0]}
      - {type: anchor, position: [1, 0, 0]}
"""

MISTAKES = {
    "": "is empty; it needs a header of joint names",
    "q\n": "must have 1 to 1000000 poses, got 0",
    "p\n0\n": "'p' is neither a joint nor a motor of plain; it has m, q",
    "m\n0\n": "has no column for the joint q",
    "q,q\n0,0\n": "has two columns q",
    "q\n0,1\n": "pose 1 has 2 entries, the header 1",
    "q\n0\nx\n": "pose 2, q must be a number, got 'x'",
    "q\nnan\n": "pose 1, q must be a number, got 'nan'",
    "q\n0.6\n": "pose 1, q must lie in the joint's range [-0.5, 0.5], got 0.6",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_every_mistake_in_the_poses_is_one_line(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, poses, out = tmp_path / "r.yaml", tmp_path / "p.csv", tmp_path / "o.csv"
    robot.write_text(PLAIN)
    poses.write_text(text)
    assert check_robot.main([str(robot), "--poses", str(poses), "--geometry-csv", str(out)]) == 2
    (message,) = capsys.readouterr().err.splitlines()
    assert message.startswith("check_robot: ")
    assert MISTAKES[text] in message
    assert not out.exists()


def test_poses_and_geometry_belong_together(capsys: pytest.CaptureFixture[str]) -> None:
    assert check_robot.main(["hoist", "--poses", "p.csv"]) == 2
    assert "--poses and --geometry-csv belong together" in capsys.readouterr().err
