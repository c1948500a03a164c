"""``commission``: what its steps bring for robots that differ from their file."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml
from support.compared import covered, each
from support.places import PROTOTYPE, ROBOT
from truth import scenes

from cdrj_ros.commands import commission
from cdrj_ros.commands import commission_steps as steps
from cdrj_ros.commands.commission_judged import foretold, judged
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document, parse_robot
from cdrj_ros.robot.writer import with_section
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, random
from cdrj_ros.simulation.truth import simulate

RATE = 25.0
EPOCH_NS = 1_700_000_000_000_000_000
TRUTH = {
    "joints.elbow.offset": np.radians(-0.8), "joints.elbow.reference_angle": np.radians(1.1),
    "cables.upper.preload": 33.0, "friction.mu_c": 0.175,
}  # fmt: skip
"""Each number is off by about one of its default standard deviations."""


@cache
def moved(seed):
    """Stamps, truth of the rig with eight contact cells per pulley, and what the encoders read."""
    document = load_document(PROTOTYPE)[0]
    robot = build_robot(with_numbers(document, TRUTH), "truth")
    time = np.arange(0.0, 25.0, 1.0 / RATE)
    angle = random(np.radians(33.0), 0.4, seed)(time - 0.5)
    torque = make_load("rolling").torque(*differences(time, angle))
    truth = simulate(robot, time, angle, torque, 20.0, allow_slack=True)
    readings = {
        "winch": truth.motor_angle[:, 0],
        "elbow": truth.joint_angle[:, 0] - TRUTH["joints.elbow.offset"],
    }
    return EPOCH_NS + np.round(time * 1e9).astype(np.int64), truth, readings


def write(path, stamps, readings, effort=None, cell=None):
    """A bag as a robot's drivers fill it."""
    topics = Topics()
    with BagWriter(path) as bag:
        bag.write_joint_states(
            topics.motors, stamps, ["winch"], readings["winch"][:, None], effort=effort
        )
        bag.write_joint_states(topics.joints, stamps, ["elbow"], readings["elbow"][:, None])
        if cell is not None:
            bag.write_tensions(topics.references[0], stamps, ["upper/8"], cell)
    return str(path)


def share_shown(model, stamps, readings, effort):
    """Share of the tensions that are OK in a node that hears a recording, after a quarter of it."""
    live, ok = LiveEstimator(model), []
    for k, stamp in enumerate(stamps.tolist()):
        live.feed_efforts(stamp, ["winch"], effort[k])
        live.feed("motors", stamp, ["winch"], readings["winch"][k : k + 1])
        _, made = live.feed("joints", stamp, ["elbow"], readings["elbow"][k : k + 1])
        ok += [one.status == 0 for one in made]
    return np.mean(ok[len(ok) // 4 :])


def test_every_measurement_of_the_prototype_brings_it_nearer_to_ok(tmp_path, capsys):
    robot, out = tmp_path / "robot.yaml", tmp_path / "commissioned.yaml"
    fresh = with_section(PROTOTYPE.read_text(encoding="utf-8"), "uncertainty", None)
    robot.write_text(fresh, encoding="utf-8")
    generator = np.random.default_rng(0)
    stamps, truth, readings = moved(1)
    effort = truth.motor_effort + generator.normal(0.0, 0.02, (stamps.size, 1))
    cell = truth.tension[:, 7:8] + generator.normal(0.0, 0.1, (stamps.size, 1))
    still = {
        "winch": np.zeros(100),
        "elbow": np.full(100, TRUTH["joints.elbow.reference_angle"] - TRUTH["joints.elbow.offset"]),
    }
    code = commission.main(
        [
            "--robot", str(robot), "--out", str(out), "--yes",
            "--rest", write(tmp_path / "rest", stamps[:100], still),
            "--preload", "upper=32.3,lower=26.8", "--drum", "winch=30.08",
            "--motion", write(tmp_path / "motion", stamps, readings, effort),
            "--cells", write(tmp_path / "cells", stamps, readings, effort, cell),
        ]
    )  # fmt: skip
    assert code == 0
    said = capsys.readouterr().out
    row = r"^([a-z ]+): OK (\d+)%(?: to (\d+)%)?; .*: upper (\S+)%, lower (\S+)%$"
    rows = re.findall(row, said, re.MULTILINE)
    assert [row[0] for row in rows] == ["new file", "rest", "preload", "drum", "motion", "cells"]
    relative = np.array([row[3:] for row in rows], dtype=float)
    assert np.all(np.diff(np.mean(relative, axis=1)) < 1.0), relative
    assert rows[0][1:3] == ("0", "")
    least, most = (float(share or rows[-1][1]) for share in rows[-1][1:3])
    shown = 100.0 * share_shown(load_model(out), stamps, readings, effort)
    assert least - 2.0 < shown < most + 2.0, "what it says of the recording is what a node shows"
    assert shown > 40.0, "readings at 25 Hz are too sparse for more"
    assert "The cable holds on its drums" in said
    written = yaml.safe_load(out.read_text(encoding="utf-8"))
    origin = written["identified"]["numbers"]
    assert origin["motors.winch.reference_angle"] == "tare, rest"
    assert origin["cables.upper.preload"] == "fit to motion, cells"
    other, wanted, read = moved(2)
    model = prepare(build_robot(load_document(out)[0], str(out)))
    motion = Recorded("other", each(other, {"winch": read["winch"]}),
                      each(other, {"elbow": read["elbow"]}), {})  # fmt: skip
    assert covered(model, motion, wanted.tension) > 0.95


def test_a_calliper_measures_all_drums_of_a_motor_and_recordings_are_foretold():
    fresh = with_section(PROTOTYPE.read_text("utf-8"), "uncertainty", None)
    now = steps.begin(fresh, ROBOT).also(drum={"winch": 0.0302})
    robot = now.model.robot
    known = robot.uncertainty
    at = [known.parameters.index(f"cables.{c.name}.nodes.1.radius") for c in robot.cables]
    np.testing.assert_allclose(known.covariance[np.ix_(at, at)], 5e-5**2, err_msg="one cause")
    assert [cable.nodes[0].radius for cable in robot.cables] == [0.0151, 0.0151]
    before, motion, cells = (
        np.mean(list(one.relative.values()))
        for one in (
            judged(now.model), foretold(now, "motion"), foretold(now, "cells")
        )
    )  # fmt: skip
    assert cells < motion < 0.25 * before  # friction of the motor is no number of the file


def test_a_scale_that_was_read_in_another_pose_is_suspected(tmp_path, capsys):
    robot = tmp_path / "robot.yaml"
    robot.write_text(with_section(PROTOTYPE.read_text("utf-8"), "uncertainty", None), "utf-8")
    stamps, truth, readings = moved(1)
    bag = write(tmp_path / "motion", stamps, readings, truth.motor_effort)
    given = ["--preload", "upper=65,lower=12", "--motion", bag]
    out = str(tmp_path / "out.yaml")
    assert commission.main(["--robot", str(robot), "--out", out, "--yes", *given]) == 0
    assert "the spring scale's reading belong to the pose of the tare?" in capsys.readouterr().out


def test_a_robot_in_space_whose_encoder_is_off_gets_an_ok_that_holds():
    """The truth is a solver of its own, with contact cells fixed to the bodies."""
    scene, off = scenes.scene("skew cylinders"), np.radians(1.2)
    read, truth = scene.joint - np.array([off, 0.0]), scenes.truth_of(scene)
    document = dict(scene.robot.document)
    for joint, angles in zip(document["joints"], read.T, strict=True):
        joint["range"] = [float(angles.min()) - 0.1, float(angles.max()) + 0.1]
    generator = np.random.default_rng(0)
    stamps = EPOCH_NS + np.round(scene.time * 1e9).astype(np.int64)
    (motor,), (cable,) = scene.robot.motors, scene.robot.cables
    motors = each(stamps, {motor.name: truth.motor[:, 0]})
    joints = each(stamps, dict(zip((one.name for one in scene.robot.joints), read.T, strict=True)))
    noise = generator.normal(0.0, (0.02, 0.1), (stamps.size, 2)).T
    references = each(
        stamps,
        {
            f"effort/{motor.name}": truth.motor_effort[:, 0] + noise[0],
            f"tension/{cable.element_names[-1]}": truth.tension[:, -1] + noise[1],
        },
    )

    def still(angles):
        return {name: replace(one, value=np.full(stamps.size, one.value[0]))
                for name, one in angles.items()}  # fmt: skip

    now = steps.begin(yaml.safe_dump(document, sort_keys=False), "test")
    before = judged(now.model)
    now = now.also(rest=Recorded("rest", still(motors), still(joints), {}))
    now = now.also(preload=[{"cable": 40.8}])
    motion = Recorded("motion", motors, joints, references)
    now = now.also(motion=[motion])
    after = judged(now.model)
    assert before.ok < 0.1
    assert after.ok > 0.8
    assert covered(now.model, motion, truth.tension) > 0.95
    found = now.fits[0].found
    names = [unknown.name for unknown in found.unknowns]
    k = names.index("joints.swing.offset (+1)")
    default = np.radians(1.0)  # causes are in units of their standard deviations
    assert found.values[k] == pytest.approx(off / default, abs=3.0 * found.stddev[k])


def test_a_measurement_that_is_none_is_refused_in_one_line(tmp_path, capsys):
    robot = tmp_path / "robot.yaml"
    robot.write_text(with_section(PROTOTYPE.read_text("utf-8"), "uncertainty", None), "utf-8")
    stamps, _, readings = moved(1)
    moving = write(tmp_path / "moving", stamps, readings)
    silent = write(tmp_path / "silent", stamps, readings, np.zeros((stamps.size, 1)))
    given = ["--robot", str(robot), "--out", str(tmp_path / "out.yaml"), "--yes"]
    for option, value, words in (
        ("--rest", moving, "not at rest"),
        ("--preload", "upper", "CABLE=N"),
        ("--preload", "left=30", "there is no cable 'left'"),
        ("--motion", silent, "they have none at all"),
        ("--drum", "elbow=30", "there is no drum of 'elbow'"),
    ):
        assert commission.main([*given, option, value]) == 2
        assert words in capsys.readouterr().err


def test_an_answer_that_is_refused_is_asked_for_again(tmp_path, capsys, monkeypatch):
    """The measurements before it are kept; a drum that two motors turn is named by one of them."""
    turned = with_section(PROTOTYPE.read_text("utf-8"), "uncertainty", None)
    turned = turned.replace("motor: winch", "motor: {winch: 0.5, second: 0.5}")
    turned = turned.replace("motors:\n", "motors:\n  - {name: second}\n", 1)
    robot, out = tmp_path / "robot.yaml", tmp_path / "out.yaml"
    robot.write_text(turned, "utf-8")
    answers = iter(["nowhere", "", "upper=36,lowr=26", "upper=36,lower=26", "second=30.4", "", ""])
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    assert commission.main(["--robot", str(robot), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "refused: nowhere" in printed
    assert "refused: there is no cable 'lowr'; there are upper, lower" in printed
    document = load_document(out)[0]
    assert [cable["preload"] for cable in document["cables"]] == [36, 26]
    assert {cable["nodes"][0]["radius"] for cable in document["cables"]} == {0.0152}


def test_a_log_without_ros_is_taken_as_a_bag_is(tmp_path, capsys):
    rows = [f"{0.01 * k:.2f},0.5,-0.01" for k in range(300)]
    (tmp_path / "rest.csv").write_text("\n".join(["t,m,j", *rows]) + "\n", "utf-8")
    columns = tmp_path / "columns.yaml"
    columns.write_text("{time: t, motors: {winch: m}, joints: {elbow: j}}", "utf-8")
    given = ["--robot", str(PROTOTYPE), "--yes", "--columns", str(columns)]
    out = tmp_path / "out.yaml"
    assert commission.main([*given, "--out", str(out), "--rest", str(tmp_path / "rest.csv")]) == 0
    document = load_document(out)[0]
    assert document["motors"][0]["reference_angle"] == pytest.approx(0.5)
    assert document["joints"][0]["reference_angle"] == pytest.approx(-0.01)
    capsys.readouterr()
    other = str(tmp_path / "other.yaml")
    assert commission.main([*given, "--out", other, "--rest", "live"]) == 2
    assert "--rest live needs ROS 2 and no --columns" in capsys.readouterr().err


URDF = """<robot name="lever"><link name="base"/><link name="arm"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>
<origin xyz="0.1 0 0"/><axis xyz="0 0 1"/><limit lower="-0.5" upper="0.5" effort="1" velocity="1"/>
</joint></robot>"""

LEVER = """name: lever
motors: [{name: winch}]
joints: []
frames: {urdf: lever.urdf}
cables:
  - name: cable
    axial_stiffness: 5000
    preload: 20
    nodes:
      - {type: winch, motor: winch, winding: 1, radius_mm: 10, position_mm: [0, 30, 0]}
      - {type: anchor, frame: arm, position_mm: [40, 10, 0]}
"""


def test_a_robot_of_a_urdf_is_commissioned_without_changing_the_urdf(tmp_path):
    (tmp_path / "lever.urdf").write_text(URDF, encoding="utf-8")
    robot, out = tmp_path / "lever.yaml", tmp_path / "out.yaml"
    robot.write_text(LEVER, encoding="utf-8")
    stamps = EPOCH_NS + 20_000_000 * np.arange(500)
    hinge = 0.01 * np.sin(np.arange(500) / 40.0)
    topics, bags = Topics(), {}
    for name, angle in {
        "rest": np.where(np.arange(500) % 2 == 0, 0.0, 2.0 * np.pi / 4096),  # a count to and fro
        "motion": hinge,
    }.items():
        bags[name] = str(tmp_path / name)
        with BagWriter(tmp_path / name) as bag:
            effort = -0.2 - angle[:, None] if name == "motion" else None
            still = np.zeros((500, 1))
            bag.write_joint_states(topics.motors, stamps, ["winch"], still, effort=effort)
            bag.write_joint_states(topics.joints, stamps, ["hinge"], angle[:, None])
    given = ["--rest", bags["rest"], "--motion", bags["motion"]]
    assert commission.main(["--robot", str(robot), "--out", str(out), "--yes", *given]) == 0
    numbers = yaml.safe_load(out.read_text(encoding="utf-8"))["identified"]["numbers"]
    assert numbers["joints.hinge.offset"] == "fit to motion"
    assert not [path for path in numbers if path.startswith("frames.")]


def chain_of(joints, max_speed):
    """A cable over some joints in a row, with all numbers exact."""
    names = [f"q{k}" for k in range(joints)]
    moved = ", ".join(f"{{joint: {name}, slope: 0.02}}" for name in names)
    return f"""
name: chain
motors: [{{name: m}}]
joints: [{", ".join(f"{{name: {name}, range: [-1, 1], max_speed: {max_speed}}}" for name in names)}]
cables:
  - name: c
    axial_stiffness: 1000
    preload: 100
    nodes: [{{type: winch, motor: m, winding: -1, radius: 0.02}}, {{type: anchor}}]
    spans: [[2, {moved}]]
uncertainty: {{others: exact}}
"""


def test_a_correction_of_an_encoder_changes_nothing_of_how_a_file_is_judged():
    plain = chain_of(2, 0.5)
    key = "correction: {angle: [-1, 0, 1], value: [0.03, -0.03, 0.03]}"
    corrected = plain.replace("{name: q0,", f"{{name: q0, {key},")
    one, other = (judged(prepare(parse_robot(text))).relative for text in (plain, corrected))
    assert other == pytest.approx(one, rel=1e-6)


@pytest.mark.parametrize(("joints", "max_speed"), [(2, 0.5), (3, 1.0), (12, 8.0)])
def test_a_file_is_judged_by_a_motion_that_the_robot_can_make(joints, max_speed):
    """Faster readings would be steps, which take status 0 away for good."""
    assert judged(prepare(parse_robot(chain_of(joints, max_speed)))).ok > 0.9
