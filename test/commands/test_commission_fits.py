"""Fits of ``commission``: the fingers of a hand get what each of them gets alone."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from support.compared import each
from support.fingers import STAMPS, WRIST, cable, finger, hand, recorded

from cdrj_ros.api import Estimator
from cdrj_ros.commands import commission_steps as steps
from cdrj_ros.commands.commission_judged import foretold, judged
from cdrj_ros.commands.commission_steps import Measured
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.alternatives import DrumFinding
from cdrj_ros.identification.entries import stated_lines
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.parts import fit_parts, parts_of, section_of
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.groups import part_of
from cdrj_ros.robot.parameters import find_number, with_numbers
from cdrj_ros.robot.reader import build_robot, parse_robot
from cdrj_ros.robot.stated import StatedNumbers, joined, stated_numbers
from cdrj_ros.robot.tolerances import default_tolerances, within_range
from cdrj_ros.robot.writer import with_section
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.motion import random
from cdrj_ros.simulation.truth import simulate


def text_of(robot):
    return yaml.safe_dump(dict(robot.document), sort_keys=False)


@pytest.fixture(scope="module")
def two():
    return hand(finger("a"), finger("b"))


def test_efforts_whose_gain_is_off_make_no_preload_wrong_and_sure():
    alone = hand(finger("b"))
    right = recorded(alone)
    more = {name: replace(one, value=1.05 * one.value) for name, one in right.references.items()}
    (fit,) = fit_parts(alone, text_of(alone), [replace(right, references=more)])
    known = dict(zip(fit.numbers.paths, fit.numbers.stddev, strict=True))
    for one in alone.cables:
        path = f"cables.{one.name}.preload"
        assert abs(fit.values[path] - one.preload) < 2.0 * known[path]
        assert known[path] > 0.03 * one.preload


@pytest.mark.parametrize("wrong", [0.93, 1.07])
def test_drums_that_are_off_by_more_than_a_preload_are_found(wrong):
    """By the file one of the stiff cables is slack, and no slope leads from there."""
    robot = hand(finger("a"))
    motion = recorded(robot)
    paths = {f"cables.a_{k}.nodes.1.radius": 0.006 * wrong ** (1 - 2 * k) for k in range(2)}
    file = build_robot(with_numbers(dict(robot.document), paths), "file")
    (fit,) = fit_parts(file, text_of(file), [motion])
    for one in fit.found.unexplained.values():
        assert one.rms < 1.2 * one.noise


def test_the_counts_that_readings_show_are_written_where_the_file_states_none(two):
    motion = recorded(two)
    count = 2.0 * np.pi / 4096
    joints = {name: replace(one, value=np.round(one.value / count) * count)
              for name, one in motion.joints.items()}  # fmt: skip
    stated = build_robot(with_numbers(dict(two.document), {"joints.a_mcp.resolution": 1e-3}), "it")
    after = steps.begin(text_of(stated), "hand").also(motion=[replace(motion, joints=joints)])
    known = {axis.name: axis.sensor.resolution for axis in after.model.robot.axes}
    assert known == pytest.approx({
        **dict.fromkeys(known, 0.0), **dict.fromkeys(joints, count), "a_mcp": 1e-3,
    })  # fmt: skip
    assert "joints.b_pip.resolution" in after.origins
    begun = np.repeat(np.arange(200), [100] + [1] * 199)
    tare = [{name: replace(one, stamp_ns=STAMPS[0] + 20_000_000 * np.arange(299),
                           log_ns=STAMPS[0] + 20_000_000 * np.arange(299), value=one.value[begun])
             for name, one in some.items()} for some in (motion.motors, joints)]  # fmt: skip
    rested = steps.begin(text_of(two), "hand").also(rest=Recorded("tare", *tare, {}))
    assert rested.model.robot.joints[0].sensor.resolution == pytest.approx(count)


def test_a_file_is_judged_at_the_rate_at_which_the_robot_was_recorded():
    """More readings tell more of counts."""
    document = dict(hand(finger("a")).document)
    counts = {f"joints.a_{one}.resolution": 0.0015 for one in ("mcp", "pip")}
    robot = build_robot(with_numbers(document, counts), "it")
    now = steps.begin(text_of(robot), "it")
    assert now.interval_ns == np.inf
    assert now.also(motion=[recorded(robot)]).interval_ns == 2e7
    efforts = {axis.name: 0.005 for axis in robot.motors}
    usual, slow, often, more = (judged(now.model, efforts, interval_ns).relative
                                for interval_ns in (2e7, np.inf, 5e6, 1e6))  # fmt: skip
    assert usual == slow
    assert often == more
    assert all(often[name] < usual[name] for name in usual)


@pytest.fixture(scope="module")
def fits(two):
    """Of two fingers, and of the second one alone."""
    alone = hand(finger("b"))
    (whole,) = fit_parts(alone, text_of(alone), [recorded(alone)])
    a, b = fit_parts(two, text_of(two), [recorded(two)])
    return {"alone": whole, "a": a, "b": b}


def test_an_unrelated_finger_changes_no_bit_of_what_another_gets(fits):
    whole, part = fits["alone"], fits["b"]
    np.testing.assert_array_equal(part.found.values, whole.found.values)
    np.testing.assert_array_equal(part.found.correlation, whole.found.correlation)
    own = {path: value for path, value in whole.values.items() if path in part.values}
    assert {path: part.values[path] for path in own} == own


def test_the_file_of_a_hand_says_of_a_finger_what_its_own_would(two, fits):
    """Bit for bit, although nothing shows whether the drums of the other finger hold."""
    hold, open_ = (DrumFinding(word, "seen", "") for word in ("hold", "may_slip"))
    held = [replace(one, found=replace(one.found, drums=dict.fromkeys(("b_0", "b_1"), hold)))
            for one in (fits["alone"], fits["b"])]  # fmt: skip
    a = fits["a"]
    other = replace(a, found=replace(a.found, drums=dict.fromkeys(("a_0", "a_1"), open_)))
    alone = hand(finger("b"))
    own, whole = (
        parse_robot(with_section(text_of(robot), "uncertainty", section_of(robot, found)))
        for robot, found in ((alone, held[:1]), (two, [other, held[1]]))
    )
    assert whole.uncertainty.may_slip == ("a_0", "a_1")
    known, part = own.uncertainty, build_robot(part_of(whole, (2, 3)), "b").uncertainty
    assert known.may_slip == part.may_slip == ()
    assert known.model_error == part.model_error
    stated = known.parameters[: known.stated]
    assert len(stated) > 20
    at = [known.parameters.index(path) for path in stated]
    # of the hand, each of the cables has its own friction
    own_of = [f"cables.b_0.{path}" if path.startswith("friction.") else path for path in stated]
    there = [part.parameters.index(path) for path in own_of]
    np.testing.assert_array_equal(
        part.covariance[np.ix_(there, there)], known.covariance[np.ix_(at, at)]
    )


def test_an_unrelated_finger_changes_no_bit_of_how_another_is_judged(two):
    one = hand(finger("b"))
    alone, whole = (judged(prepare(r), {axis.name: 0.01 for axis in r.motors}) for r in (one, two))
    assert alone.relative == {name: whole.relative[name] for name in alone.relative}
    assert [*whole.relative] == [cable.name for cable in two.cables]


@pytest.mark.parametrize(("known", "narrow"), [(0.05, True), (0.098, False), (0.2, True)])
def test_the_share_of_ok_that_is_foretold_comes_on_another_motion(known, narrow):
    """A finger with preloads known to this share, 1 % off; truth with four cells per pulley."""
    document = dict(hand(finger("a")).document)
    paths = ["cables.a_0.preload", "cables.a_1.preload"]
    entry = {"others": "exact", "parameters": paths, "stddev": [12.0 * known] * 2}
    model = prepare(build_robot({**document, "uncertainty": entry}, "finger"))
    robot = build_robot(with_numbers(document, dict.fromkeys(paths, 12.12)), "truth")
    time = np.arange(0.0, 20.0, 0.02)
    joints = np.stack([0.5 + random(0.4, 0.3, seed)(time - 0.5) for seed in (1, 2)], axis=1)
    motors = follow_joints(prepare(robot), joints).motor_angle
    truth = simulate(robot, time, joints, motor_angle=motors, cells=4, allow_slack=True)
    node, ok = Estimator(model), []
    for k, second in enumerate(time):
        stamp = 10**18 + round(1e9 * second)
        found = node.update(stamp, truth.motor_angle[k].tolist(), truth.joint_angle[k].tolist())
        if found is not None and second > 5.0:
            ok.append(found.status == 0)
    least, most = judged(model).between
    assert (most - least < 0.1) == narrow
    assert least - 0.1 <= np.mean(ok) <= most + 0.1


COUNT = 2.0 * np.pi / 4096
"""Of the joints' encoders, which the file does not state: half of what makes a tension UNSURE."""


def moved_at_random(robot, seconds, seeds):
    """Readings at 200 Hz, and the tensions, of a truth with four cells per pulley."""
    time = np.arange(0.0, seconds, 0.005)
    joints = 0.5 + np.stack([random(0.4, 0.5, seed)(time) for seed in seeds], axis=1)
    motors = follow_joints(prepare(robot), joints).motor_angle
    truth = simulate(robot, time, joints, motor_angle=motors, cells=4, allow_slack=True)
    stamps = 10**18 + np.round(1e9 * time).astype(np.int64)
    noise = np.random.default_rng(seeds).normal(0.0, 0.003, truth.motor_effort.shape)

    def named(axes, table):
        return each(stamps, dict(zip((axis.name for axis in axes), table.T, strict=True)))

    offsets = [joint.sensor.offset for joint in robot.joints]
    read = np.round((truth.joint_angle - offsets) / COUNT) * COUNT
    efforts = named(robot.motors, truth.motor_effort + noise)
    references = {f"effort/{name}": one for name, one in efforts.items()}
    motors, joints = named(robot.motors, truth.motor_angle), named(robot.joints, read)
    return Recorded("motion", motors, joints, references), truth.tension


def test_a_robot_as_far_from_its_file_as_the_defaults_say_gets_what_is_foretold():
    """All numbers of a finger are drawn; a spring scale, then a motion with torques."""
    file = hand(finger("a"))
    document, generator = dict(file.document), np.random.default_rng(4)
    drawn = {}
    for cause in default_tolerances(document):
        size = generator.standard_normal()
        for path, stddev in cause.factor.items():
            number = find_number(document, path)
            drawn[path] = within_range(document, number, np.array([size * stddev]))[0]
    robot = build_robot(with_numbers(document, drawn), "truth")
    now = steps.begin(text_of(file), "file")
    now = now.also(preload=[{one.name: 1.02 * one.preload for one in robot.cables}])
    now = now.also(motion=[moved_at_random(robot, 40.0, (1, 2))[0]])
    least, most = judged(now.model, now.heard, now.interval_ns).between
    read, tension = moved_at_random(robot, 30.0, (3, 4))
    node, motors = LiveEstimator(now.model), [axis.name for axis in robot.motors]
    axes = {**read.motors, **read.joints}
    found = []
    for k, stamp in enumerate(read.motors[motors[0]].stamp_ns.tolist()):
        node.feed_efforts(
            stamp, motors, [read.references[f"effort/{one}"].value[k] for one in motors]
        )
        found += node.feed("both", stamp, list(axes), [one.value[k] for one in axes.values()])[1]
    late = found[1000:]
    off = np.abs([one.tension for one in late] - tension[-len(late) :])
    ratio = off / [one.stddev[: off.shape[1]] for one in late]
    good = np.array([one.status == 0 for one in late])
    assert np.mean(ratio < 2.0) > 0.95
    assert np.mean(good & (ratio > 5.0)) < 0.002
    assert least - 0.1 <= good.mean() <= most + 0.1


def test_a_file_is_judged_with_efforts_as_noisy_as_those_that_were_recorded(two):
    now, motion = steps.begin(text_of(two), "hand"), recorded(two)
    heard = replace(now, measured=Measured(motion=[motion])).heard
    assert heard == pytest.approx({motor.name: 0.005 for motor in two.motors}, rel=0.25)
    silent = Measured(motion=[replace(motion, references={})])
    assert replace(now, measured=silent).heard == {}


def test_a_load_cell_in_a_finger_is_foretold_to_help_its_cables_alone(two):
    now = steps.begin(text_of(two), "hand")
    before, after = judged(now.model).relative, foretold(now, "cells").relative
    assert after["a_0"] < 0.8 * before["a_0"]
    assert [after[name] for name in ("b_0", "b_1")] == [before[name] for name in ("b_0", "b_1")]


def test_friction_of_all_cables_becomes_that_of_every_cable_of_a_part(two):
    now = steps.begin(text_of(two), "hand").also(motion=[recorded(two)])
    robot = now.model.robot
    friction = [cable.pulleys[0].friction.mu_c for cable in robot.cables]
    assert friction[0] == friction[1] != friction[2] == friction[3]
    known = robot.uncertainty
    at = [known.parameters.index(f"cables.a_{k}.friction.mu_c") for k in range(2)]
    variance = known.covariance[np.ix_(at, at)]
    np.testing.assert_allclose(variance, variance[0, 0], err_msg="one cause")


def test_a_part_without_references_keeps_what_its_file_says(two):
    motion = recorded(two)
    only = {name: one for name, one in motion.references.items() if "/a_" in name}
    now = steps.begin(text_of(two), "hand").also(motion=[replace(motion, references=only)])
    robot = now.model.robot
    assert [one.preload for one in robot.cables[2:]] == [one.preload for one in two.cables[2:]]
    entry = robot.document["uncertainty"]
    assert entry["drums"] == "may_slip"
    assert not [path for path in stated_numbers(entry).paths if path.startswith("cables.b_")]
    with pytest.raises(UsageError, match="they have none at all"):
        steps.begin(text_of(two), "hand").also(motion=[replace(motion, references={})])


def test_a_small_hand_on_a_wrist_is_fitted_as_one_and_a_large_one_by_fingers():
    small = parts_of(hand(finger("a", "palm"), finger("b", "palm"), **WRIST))
    assert [part.cables for part in small] == [(0, 1, 2, 3)]
    fingers = [finger(name, "palm", cables=4) for name in "abc"]
    large = parts_of(hand(*fingers, **WRIST))
    assert [part.cables for part in large] == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)]
    shared = {"joints.wrist.reference_angle", "joints.wrist.offset"}
    assert all(shared <= part.elsewhere for part in large)


def test_the_zero_of_a_wrist_is_fitted_with_the_cables_of_the_wrist():
    own = {"motors": [{"name": "m"}], "cables": [cable("w", "m", "palm", 0)]}
    fingers = [finger(name, "palm", cables=4) for name in "abc"]
    wrist, *others = parts_of(hand({**WRIST, **own}, *fingers))
    assert wrist.cables == (0,)
    assert "joints.wrist.offset" not in wrist.elsewhere
    assert all("joints.wrist.offset" in part.elsewhere for part in others)


def test_more_numbers_than_a_fit_has_are_written_in_groups_and_read_again():
    known = [
        StatedNumbers(tuple(f"cables.c{k}_{j}.preload" for j in range(2)), (0.5, 0.25),
                      np.array([[1.0, 0.125 * (k % 8)], [0.125 * (k % 8), 1.0]]))
        for k in range(80)
    ]  # fmt: skip
    block = yaml.safe_load("\n".join(["uncertainty:", *stated_lines(joined(known))]))
    again = stated_numbers(block["uncertainty"])
    assert set(again.paths) == {path for one in known for path in one.paths}
    order = [again.paths.index(path) for one in known for path in one.paths]
    np.testing.assert_array_equal(again.part(order).covariance, joined(known).covariance)
    assert "parameters" not in block["uncertainty"]
    few = yaml.safe_load("\n".join(["uncertainty:", *stated_lines(known[1])]))["uncertainty"]
    assert few["parameters"] == [*known[1].paths]
