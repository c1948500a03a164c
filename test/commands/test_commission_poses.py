"""``commission``: a spring scale that is read in several poses."""

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from support.compared import covered, each
from support.places import PROTOTYPE

from cdrj_ros.commands import commission
from cdrj_ros.commands import commission_steps as steps
from cdrj_ros.commands.commission_judged import judged
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.entries import fitted_numbers, uncertainty_section
from cdrj_ros.identification.fit import Identification
from cdrj_ros.identification.observations import Recorded, samples_of
from cdrj_ros.identification.parts import unknowns_of
from cdrj_ros.identification.poses import rest_poses
from cdrj_ros.model.prepared import prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document, parse_robot
from cdrj_ros.robot.stated import stated_numbers
from cdrj_ros.robot.writer import with_section
from cdrj_ros.simulation.assembly import divide_contacts
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.truth import simulate

RATE = 50.0
EPOCH_NS = 1_700_000_000_000_000_000
FRESH = with_section(PROTOTYPE.read_text(encoding="utf-8"), "uncertainty", None)
RADIUS = 15.3e-3
OFF = np.radians(-0.8)
"""Of the joint's encoder."""
TRUTH = {
    "joints.elbow.offset": OFF, "cables.upper.nodes.1.radius": RADIUS,
    "cables.lower.nodes.1.radius": RADIUS, "cables.upper.preload": 34.0,
}  # fmt: skip
ENDS = ("upper/8", "lower/8")


def at_rest_in(degrees, rest_s=2.5):
    """Angles of a joint that moves from each to the next, and rests where one follows itself."""
    way = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, round(2.0 * RATE) + 1) / round(2.0 * RATE))
    parts = [np.full(round(rest_s * RATE), np.radians(degrees[0]))]
    for before, after in pairwise(degrees):
        ends = np.radians((before, after))
        still = before == after
        parts.append(np.full(round(rest_s * RATE), ends[0]) if still else
                     ends[0] + (ends[1] - ends[0]) * way)  # fmt: skip
    return np.concatenate(parts)


COURSE = (0.0, -32.0, -32.0, 32.0, 32.0, *(-32.0, 32.0) * 4, 0.0, 0.0)
"""The reference pose, both ends, to and fro, and the reference pose again [degrees]."""


def series(name, angle):
    stamps = EPOCH_NS + np.round(np.arange(len(angle)) / RATE * 1e9).astype(np.int64)
    return each(stamps, {name: angle})


@cache
def rig(course):
    """What the encoders read of a rig with eight contact cells per pulley, and its tensions."""
    robot = build_robot(with_numbers(load_document(PROTOTYPE)[0], TRUTH), "truth")
    joint = at_rest_in(course)[:, None]
    time = np.arange(len(joint)) / RATE
    motor = follow_joints(prepare(robot), joint).motor_angle
    truth = simulate(robot, time, joint, motor_angle=motor, allow_slack=True)
    read = Recorded("poses", series("winch", truth.motor_angle[:, 0]),
                    series("elbow", truth.joint_angle[:, 0] - OFF), {})  # fmt: skip
    return read, truth


@cache
def slipping():
    """Tensions of the same motion if the cable slipped on its drum."""
    robot = build_robot(with_numbers(load_document(PROTOTYPE)[0], TRUTH), "truth")
    model, (_, truth) = prepare(divide_contacts(robot, 4)), rig(COURSE)
    stamps = EPOCH_NS + np.arange(1, len(truth.motor_angle) + 1) * round(1e9 / RATE)
    samples = Samples(stamps, truth.motor_angle.copy(), truth.joint_angle.copy())
    found = run(model, initial_state(model), samples, slipping=np.array([True, True]))[1]
    return found.values[:, model.layout.tension]


def rests(model, recorded):
    return rest_poses(model.robot, samples_of(model, recorded), recorded.name)


def scale_readings(tension=None):
    """A spring scale whose gain is 3 % too high, in all poses; each reading errs by 1 %."""
    recorded, truth = rig(COURSE)
    generator = np.random.default_rng(1)
    found = []
    for pose in rests(prepare(parse_robot(FRESH, "fresh")), recorded):
        rows = truth.tension if tension is None else tension
        row = rows[round((pose.stamp_ns - EPOCH_NS) * 1e-9 * RATE)]
        errors = 1.03 * generator.normal(1.0, 0.01, 2)
        found.append(dict(zip(ENDS, (row[[7, 15]] * errors).tolist(), strict=True)))
    return found


def test_readings_in_three_poses_show_the_radius_and_bring_an_ok_that_holds():
    recorded, _ = rig(COURSE)
    tared = steps.begin(FRESH, str(PROTOTYPE)).also(rest=recorded)
    one = tared.also(preload=scale_readings()[:1])
    three = tared.also(preload=scale_readings())
    before, after = judged(one.model), judged(three.model)
    assert after.ok > 0.3 > before.ok
    assert all(after.relative[name] < 0.75 * before.relative[name] for name in before.relative)
    known = three.model.robot.uncertainty
    k = known.parameters.index("cables.upper.nodes.1.radius")
    stddev = float(np.sqrt(known.covariance[k, k]))
    assert stddev < 0.25e-3
    assert three.model.robot.cables[0].nodes[0].radius == pytest.approx(RADIUS, abs=2.5 * stddev)
    other, truth = rig((0.0, 25.0, -30.0, 10.0, -15.0, 33.0, 0.0))
    assert covered(three.model, other, truth.tension) > 0.95


def test_a_reading_back_in_the_first_pose_shows_whether_the_drum_holds_the_cable():
    recorded, _ = rig(COURSE)
    tared = steps.begin(FRESH, str(PROTOTYPE)).also(rest=recorded)
    for tension, comment in ((None, "cable that slips makes"), (slipping(), "cable that holds")):
        after = tared.also(preload=scale_readings(tension))
        (fit,) = after.fits
        assert all(one.comment.startswith(comment) for one in fit.found.drums.values())
        assert set(fit.found.drums) == {"upper", "lower"}


def test_a_motion_that_the_model_explains_less_well_takes_nothing_from_the_readings():
    """Its friction differs from the file, and its residuals last, unlike errors of readings."""
    recorded, _ = rig(COURSE)
    tared = steps.begin(FRESH, str(PROTOTYPE)).also(rest=recorded)
    before = tared.also(preload=scale_readings())
    other, truth = rig((0.0, 25.0, -30.0, 10.0, -15.0, 33.0, 0.0))
    stamps = other.motors["winch"].stamp_ns
    noise = np.random.default_rng(2).normal(0.0, 0.02, stamps.size)
    effort = truth.motor_effort[:, 0] + 0.05 * np.sin(stamps * 1e-9) + noise
    references = each(stamps, {"effort/winch": effort})
    after = before.also(motion=[replace(other, references=references)])
    (fit,) = after.fits
    assert {one.drums for one in fit.found.drums.values()} == {"hold"}
    radii = []
    for one in (before, after):
        known = one.model.robot.uncertainty
        k = known.parameters.index("cables.upper.nodes.1.radius")
        radii.append(np.sqrt(known.covariance[k, k]))
    assert radii[1] < 1.1 * radii[0]


def test_a_gain_that_is_common_to_all_readings_changes_preloads_alone():
    recorded, _ = rig(COURSE)
    tared = steps.begin(FRESH, str(PROTOTYPE)).also(rest=recorded)
    plain, more = (
        tared.also(preload=[{k: gain * v for k, v in row.items()} for row in scale_readings()])
        for gain in (1.0, 1.01)
    )
    first, second = plain.model.robot.cables[0], more.model.robot.cables[0]
    assert second.preload == pytest.approx(1.01 * first.preload, rel=2e-3)
    assert second.nodes[0].radius == pytest.approx(first.nodes[0].radius, abs=2e-5)


def test_what_was_known_of_preloads_of_one_scale_is_kept_by_data_that_show_nothing():
    """Two causes of error for the same two numbers, whose covariance adds up again."""
    now = steps.begin(FRESH, str(PROTOTYPE)).also(preload=[{"upper": 30.0, "lower": 20.0}])
    robot = now.model.robot
    known = robot.uncertainty
    unknowns = unknowns_of(robot, now.base)
    size = len(unknowns)
    found = Identification(
        unknowns, np.zeros(size), np.ones(size), np.eye(size), (), (), 0, 0, 0.0, 0
    )
    assert found.by_path["cables.upper.preload"] == pytest.approx(30.0)
    entry = yaml.safe_load(uncertainty_section(fitted_numbers(found, {}), {}, {}, {}))[
        "uncertainty"
    ]
    stddev = dict(zip(entry["parameters"], entry["stddev"], strict=True))
    for path, variance in zip(known.parameters, np.diag(known.covariance), strict=True):
        assert stddev[path] == pytest.approx(np.sqrt(variance), rel=5e-3), path
    i, j = (entry["parameters"].index(f"cables.{name}.preload") for name in ("upper", "lower"))
    assert stddev["cables.upper.preload"] == pytest.approx(0.045 * 30.0)
    common = 1.0 - (1.0 / 4.5) ** 2  # 1 % is its own
    assert stated_numbers(entry).correlation[i, j] == pytest.approx(common, abs=1e-3)


def test_a_rest_is_a_pose_once_and_a_tare_does_not_begin_in_motion():
    model = prepare(parse_robot(FRESH, "fresh"))

    def poses(joint):
        recorded = Recorded("bag", series("winch", 8.0 * joint), series("elbow", joint), {})
        return [float(np.degrees(one.joint_angle[0])) for one in rests(model, recorded)]

    touched = at_rest_in((0.0, 1.0, 0.0, 0.0, 20.0, 21.0, 20.0, 20.0, -5.0, 0.0, 0.0))
    assert poses(touched) == pytest.approx([0.0, 20.0, 0.0], abs=0.02)
    with pytest.raises(UsageError, match="not at rest: winch moved"):
        poses(at_rest_in((0.0, 20.0, 0.0))[round(3.0 * RATE) :])


def write(path):
    recorded, _ = rig(COURSE)
    topics = Topics()
    with BagWriter(path) as bag:
        for topic, axes in ((topics.motors, recorded.motors), (topics.joints, recorded.joints)):
            for name, one in axes.items():
                bag.write_joint_states(topic, one.stamp_ns, [name], one.value[:, None])
    return str(path)


def words(readings):
    return [",".join(f"{name}={value:.3f}" for name, value in row.items()) for row in readings]


def test_the_dialogue_asks_for_every_pose_and_says_the_same_as_options(
    tmp_path, capsys, monkeypatch
):
    robot = tmp_path / "robot.yaml"
    robot.write_text(FRESH, encoding="utf-8")
    given = words(scale_readings())
    answers = iter(["live", *given])
    asked = []

    def answer(question):
        asked.append(question)
        return next(answers, "")

    def record(path, topics, duration_s, on):
        assert on
        write(path)

    monkeypatch.setattr("builtins.input", answer)
    arguments = ["--robot", str(robot), "--out"]
    assert commission.body([*arguments, str(tmp_path / "asked.yaml")], record) == 0
    rows = [re.findall(r"^preload: OK .*$", capsys.readouterr().out, re.MULTILINE)]
    assert [re.findall(r"pose \d, elbow = \S+°", one) for one in asked[2:5]] == [
        ["pose 2, elbow = -31.2°"], ["pose 3, elbow = 32.8°"], ["pose 4, elbow = 0.8°"]
    ]  # fmt: skip
    options = [word for one in given for word in ("--preload", one)]
    bag = str(tmp_path / "asked_rest")
    out = str(tmp_path / "given.yaml")
    assert commission.main([*arguments, out, "--yes", "--rest", bag, *options]) == 0
    rows.append(re.findall(r"^preload: OK .*$", capsys.readouterr().out, re.MULTILINE))
    assert len(rows[0]) == 1
    assert rows[0] == rows[1]
    numbers = yaml.safe_load(Path(out).read_text(encoding="utf-8"))["identified"]["numbers"]
    assert numbers["cables.upper.nodes.1.radius"] == "fit to spring scale"


def test_readings_that_do_not_belong_to_the_poses_are_refused_in_one_line(tmp_path, capsys):
    robot = tmp_path / "robot.yaml"
    robot.write_text(FRESH, encoding="utf-8")
    given = ["--robot", str(robot), "--out", str(tmp_path / "out.yaml"), "--force", "--yes"]
    rest = ["--rest", write(tmp_path / "rest")]
    for bag, readings, said in (
        ([], ["upper=30", "upper/8=31"], "was read in 2 poses; .* in 0"),
        (rest, ["upper=30", "upper/8=31"], r"in 2 poses; .* in 4: elbow = 0\.8°; elbow = -31\.2°"),
        (rest, ["upper=30", "upper=31", "", ""], "no element 'upper'; there are upper/1 to"),
        ([], ["upper/9=30"], "no element 'upper/9'; there are upper/1 to"),
        (rest, ["upper=30", "lower/8=31", "", ""], "lower/8: read the tension of lower in the ref"),
        (rest, ["upper=30", "upper/8=-1", "", ""], r"upper/8 must be in \(0, 1e6\) N, got -1"),
    ):
        options = [word for one in readings for word in ("--preload", one)]
        assert commission.main([*given, *bag, *options]) == 2
        assert re.search(said, capsys.readouterr().err)
