"""Verdicts: what has changed on the robot, by how much, from which sensors."""

from dataclasses import replace

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros._core import mark_unsure
from cdrj_ros.estimation.ensemble import NO_STDDEVS, UNSURE_SHARE
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.estimation.unknowns import FRICTION, PRELOAD, ZERO, ZERO_M
from cdrj_ros.estimation.verdict_words import report
from cdrj_ros.estimation.verdicts import Change, Finding, Verdict
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import INVALID, OK, SLACK, UNSURE
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Pulley
from cdrj_ros.robot.reader import build_robot, parse_robot
from cdrj_ros.simulation.drives import follow_joints

CELLS = ("upper/8", "lower/8")
EFFORT_NOISE, CELL_NOISE = 0.01, 0.1
BOTH = ("effort", "cells")
UPPER, LOWER = slice(0, 8), slice(8, 16)


@pytest.fixture(scope="module")
def motion(model, recorded):
    """Recorded angles of three cycles of 10 s, at 25 Hz."""
    whole = recorded(model, 60)
    return whole.part(slice(whole.stamp_ns.size // 2))


def with_preload(share, *names):
    return lambda robot: replace(
        robot,
        cables=tuple(
            replace(c, preload=share * c.preload) if c.name in names else c for c in robot.cables
        ),
    )


def rougher(robot):
    """A robot with twice the coefficients of friction."""

    def pulley(node):
        own = node.friction
        return replace(node, friction=replace(own, mu_c=2.0 * own.mu_c, mu_s=2.0 * own.mu_s))

    return replace(
        robot,
        cables=tuple(
            replace(c, nodes=tuple(pulley(n) if isinstance(n, Pulley) else n for n in c.nodes))
            for c in robot.cables
        ),
    )


def without_upper(robot):
    upper, lower = robot.cables
    return replace(robot, cables=(replace(upper, preload=0.0, axial_stiffness=1e-5), lower))


def same(robot):
    return robot


def true_readings(model, robot, motion):
    """Motor effort [N m] and both cells [N] of a changed robot, shape (n, 3)."""
    real = prepare(robot(model.robot), check_range=False)
    values = run(real, initial_state(real), motion)[1].values
    names = real.layout.elements
    columns = [real.layout.motor_effort.start] + [
        real.layout.tension.start + names.index(one) for one in CELLS
    ]
    return values[:, columns]


def heard(model, motion, readings, sensors=BOTH, live=None):
    """An estimator that hears noisy readings."""
    live = live or LiveEstimator(model)
    generator = np.random.default_rng(0)
    for k, stamp in enumerate(motion.stamp_ns.tolist()):
        effort = readings[k, :1] + generator.normal(0.0, EFFORT_NOISE, 1)
        cells = readings[k, 1:] + generator.normal(0.0, CELL_NOISE, 2)
        if "effort" in sensors:
            live.feed_efforts(stamp, ["winch"], effort)
        if "cells" in sensors:
            live.feed_tensions(stamp, CELLS, cells, [CELL_NOISE] * 2)
        live.take(motion.at(k))
    return live


def report_of(live):
    return live.corrections.report()


def found(live):
    """Amounts of the changes in the verdict, by name."""
    verdict = live.corrections.groups[0].verdict
    return {one.change.what: one.amount for one in verdict.found if one.matters}


@pytest.mark.parametrize("sensors", [("effort",), ("cells",), BOTH])
def test_a_robot_that_is_as_its_file_says_raises_no_alarm(model, motion, sensors):
    live = LiveEstimator(model)
    readings = true_readings(model, same, motion)
    for begin in range(0, motion.stamp_ns.size, 25):
        part = slice(begin, begin + 25)
        heard(model, motion.part(part), readings[part], sensors, live)
        assert report_of(live).level == "ok", report_of(live).message
    assert report_of(live).message == "agrees with the robot file"
    assert not live.corrections.doubted.any()


@pytest.mark.parametrize(
    ("changed", "what", "amount", "within"),
    [
        (with_preload(0.9, "upper"), "preload of upper", -3.685, 0.4),
        (with_preload(0.85, "lower"), "preload of lower", -3.94, 0.4),
        (with_preload(0.8, "upper", "lower"), "preload of all cables", -20.0, 2.0),
        (rougher, "friction of all cables", 100.0, 20.0),
    ],
)
def test_a_change_is_named_and_quantified(model, motion, changed, what, amount, within):
    live = heard(model, motion, true_readings(model, changed, motion))
    assert found(live) == {what: pytest.approx(amount, abs=within)}
    assert report_of(live).level == "warn"
    assert report_of(live).message.startswith(what)
    assert "times likelier than " in report_of(live).message


def test_a_wrong_zero_is_found_by_the_effort_alone(model, motion):
    readings = true_readings(model, same, motion)
    off = np.radians(1.0)
    wrong = Samples(motion.stamp_ns, motion.motor_angle, motion.joint_angle + off)
    live = heard(model, wrong, readings, ("effort",))
    assert found(live) == {"zero of joint elbow": pytest.approx(-1.0, abs=0.1)}
    assert "too much" in report_of(live).message
    said = report_of(live).values["deviation of winch [N m]"].replace(",", "").split()
    error = (readings - true_readings(model, same, wrong))[-125:, 0]
    assert float(said[0]) == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=0.2)
    assert float(said[4]) < 2.0 * EFFORT_NOISE


def test_friction_of_the_motor_is_told_from_that_of_the_cables_by_load_cells(model, motion):
    readings = true_readings(model, same, motion)
    speed = np.gradient(motion.motor_angle[:, 0])
    readings[:, 0] -= 0.06 * np.sign(np.where(np.abs(speed) > 1e-6, speed, 0.0))
    live = heard(model, motion, readings)
    assert found(live) == {"friction of the axis winch": pytest.approx(0.06, abs=0.015)}
    alone = heard(model, motion, readings, ("effort",)).corrections.groups[0].verdict
    assert any("of all cables" in other for one in alone.found for other in one.others)


def test_a_broken_cable_is_an_error_and_its_elements_are_unsure_at_once(model, motion):
    whole = true_readings(model, same, motion)
    gone = true_readings(model, without_upper, motion)
    at = whole.shape[0] // 2
    readings = np.where((np.arange(len(whole)) >= at)[:, None], gone, whole)
    until = at + int(6.0 / np.median(np.diff(motion.stamp_ns)) * 1e9)
    begin = motion.part(slice(until))
    live = heard(model, begin, readings)
    assert report_of(live).level == "error"
    assert "cable upper carries nothing" in report_of(live).message
    doubted = live.corrections.doubted
    assert doubted[UPPER].all()
    assert not doubted[LOWER].any()
    silent = motion.part(slice(until, until + 500))
    for k in range(silent.stamp_ns.size):
        status = live.take(silent.at(k)).status
    assert all(int(one) & UNSURE for one in status[UPPER]), "a silent sensor takes nothing back"


def test_a_load_cell_that_reads_nothing_may_be_dead_itself(model, motion):
    readings = true_readings(model, same, motion)
    readings[:, 1] = 0.0
    live = heard(model, motion, readings, ("cells",))
    assert "cable upper carries nothing" in report_of(live).message
    assert "or: scale of load cell upper/8" in report_of(live).message
    both = report_of(heard(model, motion, readings))
    assert both.level == "warn", "the effort says that the cable carries"
    assert both.message.startswith("scale of load cell upper/8 is")


def test_a_wrong_scale_of_an_effort_is_answered_with_the_key_and_its_value(model, motion):
    motor = replace(model.robot.motors[0], effort_scale=0.5)
    scaled = replace(model, robot=replace(model.robot, motors=(motor,)))
    readings = true_readings(model, same, motion)
    readings[:, 0] *= -1.0
    message = report_of(heard(scaled, motion, readings)).message
    assert message.startswith("scale of effort of winch is 20")
    assert "if its sign is wrong, the other effort_sign mends it" in message
    assert "radius_mm" not in message, "no drum turns the other way"
    readings[:, 0] *= -0.7
    message = report_of(heard(model, motion, readings)).message
    assert float(message.split("if its drum is, radius_mm: ")[1].split()[0]) == pytest.approx(
        0.7 * 15.0, rel=0.05
    )


def test_efforts_of_the_other_sign_are_answered_with_the_key_and_not_with_lost_preload():
    text = (ROBOTS / "finger.yaml").read_text()
    model = prepare(parse_robot(f"prefix: arm/\n{text}"))
    seconds = np.arange(0.0, 8.0, 0.04)
    swing = 0.3 * np.sin(2.0 * np.pi * 0.3 * seconds)
    joints = model.robot.reference_pose + swing[:, None]
    stamps = 1_000_000_000 + np.round(1e9 * seconds).astype(np.int64)
    samples = Samples(stamps, follow_joints(model, joints).motor_angle, joints)
    efforts = run(model, initial_state(model), samples)[1].values[:, model.layout.motor_effort]
    readings = -efforts + np.random.default_rng(0).normal(0.0, 0.003, efforts.shape)
    live = LiveEstimator(model)
    for k, stamp in enumerate(stamps.tolist()):
        live.feed_efforts(stamp, model.layout.motors, readings[k])
        live.take(samples.at(k))
    said = report_of(live)
    keys = ", ".join(f"motors.{name}.effort_sign: -1" for name in model.layout.motors)
    assert said.message == f"efforts are opposite to the cables' pull; {keys} fits"
    # a name with a prefix is no load cell's
    assert [key for key in said.values if key.endswith("[N m]")] == [
        f"deviation of {name} [N m]" for name in model.layout.motors
    ]


def test_what_no_change_explains_takes_the_status_ok_away_until_it_ends(model, motion):
    readings = true_readings(model, same, motion)
    wrong = readings.copy()
    wrong[:, 0] = 3.0 * np.cos(7.0 * motion.joint_angle[:, 0])
    live = heard(model, motion, wrong, ("effort",))
    assert "no single change" in report_of(live).message
    last = motion.at(motion.stamp_ns.size - 1)
    later_still = last._replace(stamp_ns=last.stamp_ns + 10_000_000)
    assert all(int(one) & UNSURE for one in live.take(later_still).status)
    passed = int(motion.stamp_ns[-1] - motion.stamp_ns[0]) + 40_000_000
    for k in (1, 2):
        later = replace(motion, stamp_ns=motion.stamp_ns + k * passed)
        heard(model, later, readings, ("effort",), live)
    assert report_of(live).level == "ok", report_of(live).message
    assert not live.corrections.doubted.any()


def test_a_lone_wrong_reading_is_no_evidence(model, motion):
    readings = true_readings(model, same, motion)
    readings[100::150, 0] = 100.0
    live = LiveEstimator(model)
    for begin in range(0, motion.stamp_ns.size, 25):
        part = slice(begin, begin + 25)
        heard(model, motion.part(part), readings[part], live=live)
        assert report_of(live).level == "ok", report_of(live).message


def test_the_clock_may_be_set_back_and_readings_may_pause(model, motion):
    readings = true_readings(model, same, motion)
    live = heard(model, motion, readings)
    live.reset()
    heard(model, motion, readings, live=live)
    late = replace(motion, stamp_ns=motion.stamp_ns + 10**12)
    heard(model, late, readings, live=live)
    assert report_of(live).level == "ok", report_of(live).message
    assert not live.corrections.doubted.any()


def test_a_change_within_the_tolerance_of_the_file_is_no_alarm(model, motion):
    document = {k: v for k, v in model.robot.document.items() if k != "uncertainty"}
    fresh = prepare(build_robot(document, "fresh"))  # preloads are known to 10 %
    readings = true_readings(model, with_preload(0.9, "upper"), motion)
    assert report_of(heard(fresh, motion, readings)).level == "ok"
    assert report_of(heard(model, motion, readings)).level == "warn"


def test_the_other_flags_of_unsure_elements_are_kept(model):
    values, doubted = np.zeros((2, model.layout.size))
    status, marked = values[model.layout.status], doubted[model.layout.status].astype(bool)
    status[:5] = [OK, SLACK, INVALID, UNSURE | SLACK, SLACK]
    marked[:4] = True
    mark_unsure(model.core, values, NO_STDDEVS, UNSURE_SHARE, marked)
    assert status[:5].tolist() == [UNSURE, SLACK | UNSURE, INVALID, UNSURE | SLACK, SLACK]
    status[:] = 0.0
    assert not values.any()


def test_an_effort_that_is_not_measured_is_not_compared(model, motion):
    live = LiveEstimator(model)
    for k, stamp in enumerate(motion.stamp_ns.tolist()):
        live.feed_efforts(stamp, ["winch"], [0.0])
        live.take(motion.at(k))
    assert report_of(live).level == "ok", report_of(live).message
    assert "repeat their readings" in report_of(live).message
    assert not live.corrections.doubted.any()


def at_rest(model, motion, pose):
    """The motion up to where the joint is near the pose, a second there, half of it at rest."""
    near = np.abs(motion.joint_angle[:, 0] - pose) < 0.02
    until = int(np.flatnonzero(near)[-1])
    begin, last = motion.part(slice(until)), motion.at(until - 1)
    share = np.minimum(np.arange(1, 51) / 25.0, 1.0)[:, None]
    stamps = begin.stamp_ns[-1] + np.arange(1, 51) * 20_000_000
    joint = last.joint_angle + share * (pose - last.joint_angle)
    motor = np.tile(last.motor_angle, (50, 1))
    return Samples(
        np.concatenate([begin.stamp_ns, stamps]), np.concatenate([begin.motor_angle, motor]),
        np.concatenate([begin.joint_angle, joint]),
    )  # fmt: skip


@pytest.mark.parametrize("sensors", [("effort",), BOTH])
def test_a_tare_takes_the_zero_that_sensors_have_shown(model, motion, sensors):
    """Whoever sets the pose by eye knows it no better."""
    off = np.radians(1.0)
    rest = at_rest(model, motion, 0.01)
    wrong = replace(rest, joint_angle=rest.joint_angle + off)
    live = heard(model, wrong, true_readings(model, same, rest), sensors)
    assert "by the sensors" in live.tare()
    assert live.changes == {"joints.elbow.reference_angle": pytest.approx(off, abs=0.3 * off)}


@pytest.mark.parametrize("sensors", [("effort",), ("cells",)])
def test_a_tare_in_a_loaded_pose_is_refused(model, motion, sensors):
    rest = at_rest(model, motion, 0.0)
    loaded = rest.joint_angle.copy()
    loaded[-50:] += np.minimum(np.arange(1, 51) / 25.0, 1.0)[:, None] * 0.04
    rest = replace(rest, joint_angle=loaded)
    live = heard(model, rest, true_readings(model, same, rest), sensors)
    with pytest.raises(UsageError, match=r"the pose is loaded, or preloads have changed"):
        live.tare()
    assert live.changes == {}


def test_a_tare_far_from_the_pose_that_sensors_show_is_refused(model, motion):
    rest = at_rest(model, motion, 0.2)
    wrong = replace(rest, joint_angle=rest.joint_angle + np.radians(1.0))
    live = heard(model, wrong, true_readings(model, same, rest))
    with pytest.raises(UsageError, match="sensors show the reference pose at elbow"):
        live.tare()


def test_a_tare_takes_the_preload_that_a_load_cell_has_shown(model, motion):
    rest = at_rest(model, motion, 0.0)
    readings = true_readings(model, with_preload(0.8, "upper"), rest)
    live = heard(model, rest, readings)
    live.tare()
    assert live.model.robot.cables[0].preload == pytest.approx(0.8 * 36.85, rel=0.06)
    assert live.model.robot.cables[1].preload == model.robot.cables[1].preload


@pytest.mark.parametrize(
    ("kind", "broken", "left", "words"),
    [(PRELOAD, "", 1.0, "winch turns"), (FRICTION, "", 1.0, "winch turns"),
     (ZERO, "", 1.0, "{}; or winch turns"), (ZERO_M, "", 1.0, "{}; or winch turns"),
     (ZERO, "", 99.0, "winch turns; or {}"), (PRELOAD, "upper", 1.0, "winch turns; or {}")],
)  # fmt: skip
def test_a_motor_that_turns_too_far_is_said_in_place_of_what_it_looks_like(
    model, kind, broken, left, words
):
    """A joint's zero and a broken cable look like such a motor, and are said beside it."""
    change = Change("what", kind, "unit", 1.0, 0.1, (0,))
    deviation = {"winch": (3.0, 2.0)}
    verdict = Verdict((Finding(change, 0.5, 0.1, (), 9.0),), broken, left, deviation=deviation)
    alone, both = (report(model.robot, [None, verdict], said) for said in ("", "winch turns"))
    assert both.message == words.format(alone.message)
    assert both.level == ("error" if broken else "warn")
    assert report(model.robot, [None], "winch turns").message == "winch turns"


def test_a_change_that_several_groups_see_is_said_once(model):
    """A wrist through which the cables of five fingers pass."""
    change = Change("zero of joint wrist", ZERO, "deg", 1.0, 0.1, (0,))
    verdicts = [Verdict((Finding(change, 0.5 + 0.1 * k, 0.1, (), 9.0),)) for k in range(5)]
    message = report(model.robot, verdicts).message
    assert message.count("wrist") == 1
    assert "0.5 +- 0.1" in message
