"""``commission``: mistakes that are named, and files that are written once."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from support.compared import each
from support.fingers import finger, hand

from cdrj_ros.commands import commission
from cdrj_ros.commands import commission_steps as steps
from cdrj_ros.commands.commission_checks import refuse_efforts, swapped, unlikely, unmoved
from cdrj_ros.commands.commission_judged import Judged
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.poses import rest_poses
from cdrj_ros.model.prepared import prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.truth import simulate

EPOCH_NS = 1_700_000_000_000_000_000
RADIUS = 0.006
"""Of the drums of both cables [m]."""


def read_as(first, second):
    """A finger whose two cables were read on a spring scale [N]."""
    document = dict(hand(finger("a")).document)
    values = {"cables.a_0.preload": first, "cables.a_1.preload": second}
    return prepare(build_robot(with_numbers(document, values), "finger"))


def pulled(first, second, sign=-1.0):
    """Efforts of motors that pull with some tensions on the whole [N]."""
    stamps = EPOCH_NS + 5_000_000 * np.arange(400)
    swing = 0.1 * np.sin(np.arange(400) / 30.0)
    efforts = {
        f"effort/a_motor{k}": sign * RADIUS * (tension + swing)
        for k, tension in enumerate((first, second))
    }
    return Recorded("motion", {}, {}, each(stamps, efforts))


def test_readings_of_two_cables_that_were_swapped_are_named():
    """Truth: two flexors of 16 and 12 N over an extensor, with four contact cells per pulley."""
    document = dict(hand(finger("a", cables=3)).document)
    values = {"cables.a_0.preload": 16.0, "cables.a_1.preload": 12.0, "cables.a_2.preload": 14.0}
    robot = build_robot(with_numbers(document, values), "truth")
    time = np.arange(0.0, 20.0, 0.04)
    grown = np.clip(time - 1.5, 0.0, 1.0)[:, None]
    joints = grown * (0.45 + 0.4 * np.sin(2.0 * np.pi * time[:, None] * [0.31, 0.23]))
    motors = follow_joints(prepare(robot), joints).motor_angle
    truth = simulate(robot, time, joints, motor_angle=motors, cells=4, allow_slack=True)
    stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    noise = np.random.default_rng(0).normal(0.0, 0.002, truth.motor_effort.shape)

    def series(names, columns):
        return each(stamps, dict(zip(names, columns.T, strict=True)))

    axes = [f"a_motor{k}" for k in range(3)]
    efforts = series([f"effort/{name}" for name in axes], truth.motor_effort + noise)
    motion = Recorded("motion", series(axes, truth.motor_angle),
                      series(["a_mcp", "a_pip"], truth.joint_angle), efforts)  # fmt: skip
    right = {"a_0": 15.9, "a_1": 12.1, "a_2": 14.1}
    exchanged = {"a_0": 12.1, "a_1": 15.9, "a_2": 14.1}
    fresh = steps.begin(yaml.safe_dump(document), "finger")
    tared = fresh.also(rest=replace(motion, references={}))
    for readings, pair in ((right, None), (exchanged, ("a_0", "a_1"))):
        now = tared.also(preload=[readings]).also(motion=[motion])
        assert swapped(now) == pair


def test_efforts_of_the_wrong_sign_or_unit_are_refused_with_the_key_that_fits():
    model = read_as(14.0, 17.0)
    refuse_efforts(model, pulled(14.0, 17.0))
    refuse_efforts(model, pulled(9.0, 30.0))
    with pytest.raises(UsageError, match=r"motors\.a_motor0\.effort_sign: -1, motors\.a_motor1"):
        refuse_efforts(model, pulled(14.0, 17.0, sign=1.0))
    kgf = "9.81 to 9.81 times what the preloads give; effort_scale: 0.1019, 0.1019 fits, or .* kgf"
    with pytest.raises(UsageError, match=kgf):
        refuse_efforts(read_as(14.0 / 9.81, 17.0 / 9.81), pulled(14.0, 17.0))
    refuse_efforts(read_as(1.4, 17.0), pulled(14.0, 17.0))  # a load on one cable, not a unit


def test_a_joint_that_hardly_moves_in_a_motion_is_named():
    robot = hand(finger("a"))
    angle = 0.5 + 0.4 * np.sin(np.arange(400) / 30.0)
    stamps = EPOCH_NS + 5_000_000 * np.arange(400)
    joints = each(stamps, {"a_mcp": angle, "a_pip": 0.1 * angle})
    found = unmoved(robot, Recorded("motion", {}, joints, {}))
    assert found == pytest.approx({"a_pip": 0.08}, abs=1e-3)


@pytest.mark.parametrize("seconds", [0.4, 1.0, 1.2, 1.6, 2.0, 3.0])
@pytest.mark.parametrize("rate", [47.0, 200.0, 1000.0])
def test_a_recording_at_rest_is_a_pose_however_its_stamps_lie(seconds, rate):
    stamps = EPOCH_NS + np.round(np.arange(0.0, seconds, 1.0 / rate) * 1e9).astype(np.int64)
    stamps += np.random.default_rng(0).integers(0, 100_000, stamps.size)
    still = np.zeros((stamps.size, 2))
    (pose,) = rest_poses(hand(finger("a")), Samples(stamps, still, still), "rest")
    np.testing.assert_array_equal(pose.joint_angle, [0.0, 0.0])


def test_a_second_at_rest_before_a_motion_is_a_pose_and_less_is_named():
    robot = hand(finger("a"))

    def poses(rest):
        time = np.arange(0.0, rest + 1.0, 0.005)
        angle = np.clip(time - rest, 0.0, None)[:, None] * np.ones(2)
        stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
        return len(rest_poses(robot, Samples(stamps, angle, angle), "bag"))

    assert poses(1.2) == 1
    with pytest.raises(UsageError, match=r"bag: not at rest: .*; a tare needs 1 s at rest before"):
        poses(0.7)


def test_a_refused_measurement_leaves_no_file_behind(tmp_path, capsys):
    robot, out = tmp_path / "finger.yaml", tmp_path / "out.yaml"
    robot.write_text(yaml.safe_dump(dict(hand(finger("a")).document)), encoding="utf-8")
    stamps, topics = EPOCH_NS + 5_000_000 * np.arange(240), Topics()
    still = np.zeros((stamps.size, 2))
    with BagWriter(tmp_path / "rest") as bag:
        bag.write_joint_states(topics.motors, stamps, ["a_motor0", "a_motor1"], still)
        bag.write_joint_states(topics.joints, stamps, ["a_mcp", "a_pip"], still)
    given = ["--robot", str(robot), "--out", str(out), "--yes", "--rest", str(tmp_path / "rest")]
    assert commission.main([*given, "--drum", "none=12.1"]) == 2
    assert "there is no drum of 'none'; there are a_motor0, a_motor1" in capsys.readouterr().err
    assert not out.exists()
    assert commission.main([*given, "--drum", "a_motor0=12.1"]) == 0
    assert out.exists()


def test_a_drum_may_be_named_without_the_prefix_of_the_file():
    document = {**hand(finger("a")).document, "prefix": "lh_"}
    text = yaml.safe_dump(document)
    before = steps.begin(text, "finger")
    short, whole = (before.also(drum={name: 0.0123}) for name in ("a_motor0", "lh_a_motor0"))
    assert short.text == whole.text
    assert short.model.robot.cables[0].nodes[0].radius == pytest.approx(0.00615)


def test_a_hand_takes_a_line_a_step_and_its_cables_are_listed_once_the_worst_first(capsys):
    few = Judged(0.5, (0.45, 0.52), {"upper": 0.1, "lower": 0.2}, ("upper/8",))
    sigma = "standard deviation over tension"
    many = Judged(0.5, (0.31, 0.72), {f"cable{k}": 0.01 * (k + 1) for k in range(15)})
    assert commission.words_of(few) == f"OK 50%; {sigma}: upper 10.0%, lower 20.0%"
    assert commission.words_of(many) == f"OK 31% to 72%; {sigma}: 1.0% to 15.0%, most in cable14"
    commission.say_cables(few)
    commission.say_cables(many)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("seldom OK: upper/8; ")
    assert lines[2:4] == ["  cable14: 15.0%", "  cable13: 14.0%"]
    assert len(lines) == 17


def test_a_joint_without_encoder_needs_a_sensor_for_a_fit():
    document = dict(hand(finger("a")).document)
    document["joints"] = [{**one, "measured": one["name"] != "a_pip"} for one in document["joints"]]
    with pytest.raises(UsageError, match=r"record a_pip by a sensor .* measured: false out of"):
        steps.begin(yaml.safe_dump(document), "finger")


def test_a_measurement_that_is_unlike_the_file_is_named_with_what_may_be_wrong():
    robot = hand(finger("a"))
    text = yaml.safe_dump(dict(robot.document))
    before = steps.begin(text, "finger")

    def said(**measured):
        return list(unlikely(before, before.also(**measured)))

    assert not said(drum={"a_motor0": 2.0 * RADIUS})
    words = said(drum={"a_motor0": RADIUS})
    assert words
    assert all(f"{0.5 * RADIUS:.4g} now, the file has {RADIUS:.4g} +- " in one for one in words)
    assert all(one.endswith("does --drum give the diameter, in mm?") for one in words)
