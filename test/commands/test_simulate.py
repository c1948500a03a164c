"""Tests of the command ``simulate``: effects of all options, and messages for invalid ones."""

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from support.places import PROTOTYPE, ROBOT, SAMPLE

from cdrj_ros.commands.simulate import main
from cdrj_ros.messages.topics import TENSION_SENSORS, in_namespace
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics, read_recording

QUICK = ("--duration", "4", "--cells", "1", "--frequency", "0.25", "--amplitude", "20deg")


def run(path, *options):
    assert main([str(path), "--robot", ROBOT, *QUICK, *options]) == 0
    return read_recording(path)


def rig(folder, text):
    """The options that name a rig file of this content."""
    (folder / "rig.yaml").write_text(text)
    return "--rig", str(folder / "rig.yaml")


def refused(capsys, path, *options):
    assert main([str(path), "--robot", ROBOT, *QUICK, *options]) == 2
    assert not path.exists(), "nothing is left behind"
    text = capsys.readouterr().err.strip().splitlines()[-1]
    assert text.startswith("simulate: ")
    return text


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return run(tmp_path_factory.mktemp("plain") / "bag")


def _tensions(recording):
    return np.stack(
        [s.value for name, s in recording.references.items() if name.startswith("tension/")]
    )


def test_the_same_command_gives_the_same_bag_and_another_seed_another(tmp_path, plain):
    again, other = run(tmp_path / "a"), run(tmp_path / "b", "--seed", "1")
    np.testing.assert_array_equal(_tensions(again), _tensions(plain))
    assert np.any(_tensions(other) != _tensions(plain))
    np.testing.assert_array_equal(again.motors["winch"].value, plain.motors["winch"].value)


def test_the_command_reproduces_the_beginning_of_a_sample_bag(tmp_path):
    """The motor of the sample bags needed no time to accelerate, see bags/README.md."""
    kept, rig = read_recording(SAMPLE), tmp_path / "rig.yaml"
    rig.write_text("drives: {max_acceleration: 1e6}", encoding="utf-8")
    command = [str(tmp_path / "bag"), "--robot", ROBOT, "--rig", str(rig), "--duration", "8"]
    assert main(command) == 0
    made = read_recording(tmp_path / "bag")
    for there, here, most in (
        (kept.motors["winch"], made.motors["winch"], 0.01),
        (kept.joints["elbow"], made.joints["elbow"], 3.01 * 2.0 * np.pi / 16384),
    ):
        count = here.value.size - 20  # derivatives near the end depend on the end of the motion
        np.testing.assert_allclose(there.value[:count], here.value[:count], rtol=0.0, atol=most)
        np.testing.assert_array_equal(there.stamp_ns[:count], here.stamp_ns[:count])


@pytest.mark.parametrize(
    ("motion", "mode"),
    [("sine", "balance"), ("ramps", "balance"), ("sine", "follow"), ("dwell", "follow"),
     ("sine", "forward"), ("random", "forward")],
)  # fmt: skip
def test_every_motion_and_every_mode_works(tmp_path, motion, mode):
    recording = run(tmp_path / "bag", "--motion", motion, "--mode", mode)
    angle = recording.joints["elbow"].value
    assert np.ptp(angle) > np.radians(2.0)
    assert np.abs(angle).max() < np.radians(21.0)
    assert np.isfinite(_tensions(recording)).all()


def test_a_fault_acts_at_its_time_and_a_note_reports_the_slack(tmp_path, plain, capsys):
    fault = "faults: [{kind: slack, cable: lower, at: 2, amount_mm: 10}]"
    broken = run(tmp_path / "bag", *rig(tmp_path, fault))
    told = capsys.readouterr().out
    tension, sound = (r.references["tension/lower/4"] for r in (broken, plain))
    time = (tension.stamp_ns - tension.stamp_ns[0]) * 1e-9
    np.testing.assert_array_equal(tension.value[time < 1.9], sound.value[time < 1.9])
    assert np.median(tension.value[time > 3.8]) == pytest.approx(0.0, abs=0.05)
    assert "note: lower is slack for " in told


def test_a_slack_cable_is_refused_with_its_place_and_a_preload_that_helps(tmp_path, capsys):
    heavy = rig(tmp_path, "load: {payload: 0.5}")
    weak = ("--preload", "10,3", *heavy)
    text = refused(capsys, tmp_path / "bag", *weak)
    assert "element lower/" in text
    assert "has no tension at t = " in text
    assert "elbow = " in text
    assert "more --preload or less --amplitude" in text
    run(tmp_path / "taut", *heavy, "--preload", "30,9")
    slack = run(tmp_path / "slack", *weak, "--allow-slack")
    assert _tensions(slack).min() < 0.1


def test_a_rig_file_acts_on_load_cells_latency_and_frozen_encoders(tmp_path):
    text = """
    load_cells: {elements: [lower/1], noise: 0.5}
    joints: {latency: 0.2}
    faults: [{kind: freeze, encoder: elbow, at: 2}]
    """
    recording = run(tmp_path / "bag", *rig(tmp_path, text))
    elbow = recording.joints["elbow"]
    after = (elbow.stamp_ns - elbow.stamp_ns[0]) * 1e-9 > 2.001
    assert np.ptp(elbow.value[after]) == 0.0
    assert np.ptp(elbow.value[~after]) > 0.05
    topics = Topics(references=(in_namespace(TENSION_SENSORS),))
    cell = read_recording(tmp_path / "bag", topics).references["tension/lower/1"]
    true = recording.references["tension/lower/1"]
    error = cell.value - np.interp(cell.stamp_ns, true.stamp_ns, true.value)
    assert 0.45 < error.std() < 0.55
    assert _delays_ns(tmp_path / "bag", "/cdrj/joint_states") == {200_000_000}
    assert _delays_ns(tmp_path / "bag", "/cdrj/motor_states") == {0}


def _delays_ns(bag, topic):
    """Log times of a topic after the stamps of its messages."""
    with next(bag.glob("*.mcap")).open("rb") as stream:
        messages = [one for *_, one in make_reader(stream).iter_messages([topic])]
    stamps = [struct.unpack_from("<iI", one.data, 4) for one in messages]
    return {
        one.log_time - second * 10**9 - ns
        for one, (second, ns) in zip(messages, stamps, strict=True)
    }


def test_a_rig_under_ros2_control_records_one_topic_of_its_broadcaster(tmp_path):
    text = "{ros2_control: {update_rate: 250}, motor_efforts: {}}"
    command = [str(tmp_path / "bag"), "--robot", ROBOT, *QUICK, *rig(tmp_path, text)]
    assert main(command) == 0
    both = Topics("/joint_states", "/joint_states")
    told = read_recording(tmp_path / "bag", both, motor_efforts=True)
    winch, elbow = told.motors["winch"], told.joints["elbow"]
    np.testing.assert_array_equal(winch.stamp_ns, elbow.stamp_ns)
    assert winch.value.size == 1001
    assert np.ptp(told.motor_efforts["winch"].value) > 0.1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--amplitude", "50deg"), "--amplitude 0.872665 leaves the range of elbow: at most 0.698"),
        (("--amplitude", "wide"), "such as 0.3 or 20deg, got 'wide'"),
        (("--cells", "0"), "--cells must be in [1, 200], got 0"),
        (("--duration", "-1"), "--duration must be in [0.01, 1e+06], got -1"),
        (("--joint", "knee"), "--joint must be one of elbow, got 'knee'"),
        (("--frequency", "fast"), "--frequency must be numbers separated by commas, got 'fast'"),
        (("--rig", "nosy"), "there is no rig file nosy, and none of that name is installed; did"),
        (("--centre", "0,0.1"), "--centre takes 1 number, got 2"),
        (("--amplitude", "0.9", "--centre", "-0"), "to either side of 0; --centre moves"),
        (("--rig", "load: {payload: 50}"), "--allow-slack permits slack"),
        (("--rig", "load: {payload: 1000}"), "at the start: a cable would have to push"),
        (
            ("--mode", "forward", "--rig", "load: {payload: 50}"),
            "hold the load in any pose of elbow",
        ),
    ],
)
def test_a_mistake_is_explained_in_one_line(tmp_path, capsys, options, words):
    given = (rig(tmp_path, one)[1] if one.startswith("load:") else one for one in options)
    assert words in refused(capsys, tmp_path / "bag", *given)


NAMES = sorted(path.stem for path in Path(ROBOT).parent.glob("*.yaml"))


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_of_the_package_performs_the_default_motion(name, tmp_path, capsys):
    """The run covers the first full stroke to either side and must not have a slack cable."""
    path = tmp_path / "bag"
    assert main([str(path), "--robot", name, "--duration", "14", "--cells", "1"]) == 0
    robot = load_model(name).robot
    joint = robot.joints[0]
    recording = read_recording(path)
    angle = recording.joints[joint.name].value
    assert np.ptp(angle) > 0.04 * (joint.upper - joint.lower)
    assert joint.lower < angle.min()
    assert angle.max() < joint.upper
    assert _tensions(recording).min() > -0.1, "taut, except for the cells' noise"
    told = capsys.readouterr().out
    assert "slack for" not in told
    usual = name.startswith("prototype")
    plain = usual or name in ("cdpr", "continuum", "finger3d", "parallel", "wrist")
    assert ("default motion" in told) != plain
    if usual:
        assert np.degrees(np.abs(angle).max()) == pytest.approx(38.0, abs=0.2)


def test_an_output_that_exists_is_refused_before_the_simulation(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        "cdrj_ros.commands.simulate._simulated", lambda *_: pytest.fail("simulated before")
    )
    (tmp_path / "bag").mkdir()
    (tmp_path / "file").touch()
    for out, words in (
        (tmp_path / "bag", "exists already"),
        (tmp_path / "file" / "x", "is not a folder"),
    ):
        assert main([str(out), "--robot", ROBOT]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert words in line


def test_positions_of_a_prismatic_joint_are_printed_in_metres(tmp_path, capsys):
    command = [str(tmp_path / "bag"), "--robot", "hoist", "--duration", "12", "--cells", "1"]
    assert main([*command, "--amplitude", "20deg"]) == 2
    assert "--amplitude of a prismatic joint is in m" in capsys.readouterr().err
    assert main([*command, "--centre", "0.5"]) == 0
    assert "load by 0.25 m about 0.5 m" in capsys.readouterr().out


def test_a_joint_may_be_named_without_the_prefix_of_the_file(tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("prefix: left_\n" + PROTOTYPE.read_text(encoding="utf-8"), encoding="utf-8")
    for name in ("elbow", "left_elbow"):
        given = ["--robot", str(robot), "--joint", name, "--duration", "0.5"]
        assert main([str(tmp_path / name), *given]) == 0
