"""``identify --from FILE``: a file for another pose from the file of one pose."""

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.commands import identify
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.identification.priors import Reach, outdated_corrections
from cdrj_ros.model.prepared import prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.parameters import number_at, with_numbers
from cdrj_ros.robot.reader import build_robot, load_document

ROBOT = ROBOTS / "davinci_jaw.yaml"
SHIFT = 1.6
"""Angle by which the jaw was zeroed anew, beyond the range of the file [rad]."""
CHANGED = {
    "joints.jaw.range.1": 1.5,
    "joints.jaw.range.2": 3.0,
    "joints.jaw.reference_angle": 0.815771 + SHIFT,
    "motors.spindle.spring_rest": 0.25,
    "cables.b.nodes.4.wrap_angle": 2.2,
    **{f"motors.spindle.correction.value.{k}": 0.0 for k in range(2, 8)},
}
"""The spindle's correction was fitted to the readings of the file's pose."""


def bag_of(path, frequency, stretch):
    """A bag of the robot in another pose; ``stretch`` is the mean turn of the jaw beyond tight."""
    document, source = load_document(ROBOT)
    model = prepare(build_robot(with_numbers(document, CHANGED), source))
    time = np.arange(0.0, 8.0, 5e-3)
    wave = np.sin(2.0 * np.pi * frequency * time)
    spindle = 0.53 + 0.5 * wave
    tight = CHANGED["joints.jaw.reference_angle"] - (spindle - 0.5) * 5.0 / 5.472599
    jaw = tight - stretch - 0.04 * np.sin(0.7 * np.pi * time)
    stamps = 1_000_000_000 + np.round(time * 1e9).astype(np.int64)
    samples = Samples(stamps, spindle[:, None].copy(), jaw[:, None].copy())
    _, estimates = run(model, initial_state(model), samples)
    torque = np.random.default_rng(1).normal(0.0, 1e-3, (time.size, 2))
    torque[:, 0] += estimates.values[:, model.layout.motor_effort.start]
    torque[:, 1] += estimates.values[:, model.layout.joint_effort.start]
    topics = Topics()
    with BagWriter(path) as bag:
        bag.write_joint_states(topics.motors, stamps, ["spindle"], spindle[:, None])
        bag.write_joint_states(topics.joints, stamps, ["jaw"], jaw[:, None])
        bag.write_joint_states(topics.references[2], stamps, ["spindle", "jaw"], effort=torque)
    return path


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pose")
    return bag_of(folder / "slow", 0.3, 0.1), bag_of(folder / "fast", 0.5, 0.18)


def test_only_what_the_pose_changed_is_fitted_and_the_range_follows_the_readings(
    bags, tmp_path, capsys
):
    out = tmp_path / "posed.yaml"
    command = [*map(str, bags), "--from", str(ROBOT), "--quick", "--out", str(out)]
    assert identify.main(command) == 0
    printed = capsys.readouterr().out
    assert "fitted: joints.jaw.reference_angle: the joint is zeroed anew" in printed
    before, _ = load_document(ROBOT)
    posed, _ = load_document(out)
    stddev = dict(
        zip(posed["uncertainty"]["parameters"], posed["uncertainty"]["stddev"], strict=True)
    )
    for path in ("joints.jaw.reference_angle", "motors.spindle.spring_rest",
                 "cables.b.nodes.4.wrap_angle"):  # fmt: skip
        off = number_at(posed, path) - CHANGED[path]
        assert abs(off) < 3.0 * stddev[path], path
    kept = ("cables.b.axial_stiffness", "cables.b.nodes.2.friction.mu_c",
            "cables.b.spans.5.slope", "motors.spindle.bearing_torque")  # fmt: skip
    old = before["uncertainty"]
    for path in kept:
        assert number_at(posed, path) == number_at(before, path)
        assert stddev[path] == old["stddev"][old["parameters"].index(path)]
    lower, upper = posed["joints"][0]["range"]
    assert lower > number_at(before, "joints.jaw.range.2"), "the poses exclude each other"
    assert lower < CHANGED["joints.jaw.reference_angle"] < upper
    assert posed["identified"]["from"] == ROBOT.name
    assert "set to zero: motors.spindle.correction: it was fitted to readings" in printed
    assert set(posed["motors"][0]["correction"]["value"]) == {0.0}
    assert set(posed["joints"][0]["correction"]["value"]) == {0.0}


def test_only_fitted_corrections_are_outdated_and_only_where_a_joint_has_left_its_range():
    document, source = load_document(ROBOT)
    known = document["uncertainty"]
    place = known["parameters"].index("joints.jaw.correction.value.3")
    for numbers in (known["parameters"], known["stddev"], known["correlation"],
                    *known["correlation"]):  # fmt: skip
        del numbers[place]
    robot = build_robot(document, source)
    moved = {"jaw": Reach(1.4, 2.4)}
    assert outdated_corrections(robot, {}) == {}
    found = outdated_corrections(robot, moved)
    assert found["motors.spindle.correction.value.2"] == 0.0
    assert "joints.jaw.correction.value.2" in found
    assert "joints.jaw.correction.value.3" not in found
    document.pop("uncertainty")
    assert outdated_corrections(build_robot(document, source), moved) == {}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--from", str(ROBOT), "--fit", "rho"], "--fit does not go with --from"),
        (["--from", str(ROBOT), "--robot", str(ROBOT)], "--robot does not go"),
        (["--from", str(ROBOT), "--start", "preload=3"], "--start does not go"),
        (["--robot", str(ROBOT)], "--fit is missing"),
        (["--fit", "rho"], "--robot is missing"),
    ],
)
def test_options_that_contradict_each_other_are_refused(arguments, words, capsys):
    assert identify.main(["no_bag", *arguments]) == 2
    assert words in capsys.readouterr().err
