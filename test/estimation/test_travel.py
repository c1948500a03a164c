"""A single mistake in the readings is named where all motors then follow the joints."""

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.estimation.travel import MotorTravel, travel_suspicion
from cdrj_ros.estimation.verdict_words import turn
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import parse_robot

TEXT = """
name: two
motors: [{name: one}, {name: two, scale: 0.5}]
joints: [{name: near, range: [-1, 1]}, {name: far, range: [-1, 1]}]
friction: {law: none, bearing_friction: 0.0, mu_c: 0.0}
cables:
  - name: short
    axial_stiffness: 6000
    preload: 20
    nodes: [{type: winch, motor: one, radius: 0.01, winding: 1}, {type: anchor}]
    spans: [{joint: near, offset: 0.3, slope: -0.03}]
  - name: long
    axial_stiffness: 6000
    preload: 20
    nodes:
      - {type: winch, motor: two, radius: 0.01, winding: 1}
      - {type: pulley, radius: 0.005, wrap_angle: 1.0}
      - {type: anchor}
    spans: [{joint: near, offset: 0.3, slope: -0.02}, {joint: far, offset: 0.3, slope: 0.05}]
"""


@pytest.fixture(scope="module")
def model():
    return prepare(parse_robot(TEXT, "two"))


TIME = np.arange(40.0)
JOINT = 0.4 * np.sin(TIME[:, None] * [0.31, 0.47] + [0.0, 1.0])
"""Angles of the joints [rad], shape (40, 2)."""
MOTOR = JOINT @ np.array([[3.0, 2.0], [0.0, -5.0]])
"""Slopes over the drums' radius times the angles: what keeps the cables' lengths [rad]."""
UNHEARD = np.full(2, np.nan)
"""Efforts of motors that read none."""


def said(model, motor, joint):
    return travel_suspicion(model, motor, joint)


def test_motors_that_follow_or_work_against_their_cables_are_not_suspected(model):
    assert said(model, MOTOR, JOINT) == ""
    assert said(model, MOTOR + 0.1 * np.cos(TIME[:, None]), JOINT) == ""
    tense = 0.3 * np.cos(TIME)[:, None] * [1.0, 0.0]
    assert said(model, tense, 0.0 * JOINT) == "", "no joint moves"
    assert said(model, 0.0 * MOTOR, JOINT) == "", "no motor moves"


def test_degrees_are_named_where_the_whole_motion_fits_the_range(model):
    small, motor = 0.02 * JOINT, 0.02 * MOTOR
    words = "seem to be in degrees{}: give scale as scale_deg, 1 where the file has none"
    assert said(model, motor, np.degrees(small)) == f"the joints {words.format('')}"
    words = words.format(" (or before gears of about 57)")
    assert said(model, np.degrees(motor), small) == f"the motors {words}"


def test_swapped_axes_are_named_as_a_swap_through_their_scales(model):
    published = MOTOR / [1.0, 0.5]
    swapped = published[:, ::-1] * [1.0, 0.5]
    words = "the readings of {} and {} seem to be swapped: exchange their names"
    assert said(model, swapped, JOINT) == words.format("one", "two")
    assert said(model, MOTOR, JOINT[:, ::-1]) == words.format("near", "far")
    mixed = np.hstack([JOINT[:, [0]], MOTOR[:, [1]]])
    assert said(model, mixed, np.hstack([MOTOR[:, [0]], JOINT[:, [1]]])) == words.format(
        "one", "near"
    )


def test_a_joint_under_the_name_of_its_only_motor_is_another_gear(model):
    """Both would explain that it turns a third as far."""
    assert said(model, MOTOR / [9.0, 1.0], JOINT * [1.0, 1.0]).startswith("one turns 0.111 times")


def test_radians_of_a_joint_that_the_file_reads_in_degrees_are_named():
    text = TEXT.replace("name: near,", "name: near, scale_deg: 1,")
    read = prepare(parse_robot(text.replace("name: far,", "name: far, scale_deg: 1,"), "two"))
    words = said(read, MOTOR, np.radians(JOINT))
    assert "or the joints in radians: scale: 1 in place of scale_deg" in words


def test_one_wrong_gear_is_still_a_scale(model):
    assert said(model, MOTOR * [1.0, -20.0], JOINT) == (
        "two turns 20 times as far as its cables allow, the other way: gear ratio, unit or sign? "
        "scale: -0.025 would fit"
    )


def test_a_wrong_drum_and_a_wrong_winding_are_named_with_both_keys_that_fit(model):
    assert said(model, MOTOR * [1.5, 1.0], JOINT) == (
        "one turns 1.5 times as far as its cables allow: "
        "scale: 0.6667 or a drum of radius_mm: 6.67 would fit"
    )
    assert said(model, MOTOR * [1.0, -1.0], JOINT) == (
        "two turns the other way than its cables allow: winding: -1 or scale: -0.5 would fit"
    )


def test_what_a_tension_can_stretch_is_no_mistake(model):
    largest = 4.0 * 20.0 * 0.3 / 6000.0 / 0.01  # four preloads on a cable of 0.3 m and 6000 N
    moved = JOINT * [0.05, 0.0]
    followed = MOTOR[:, [0]] * 0.05
    by = largest / np.ptp(followed)
    both = np.hstack([followed, moved[:, [0]] * 2.0])
    assert said(model, both * [1.0 + 0.9 * by, 1.0], moved) == ""
    assert said(model, both * [1.0 + 1.2 * by, 1.0], moved).startswith("one turns")


def test_nothing_is_said_of_few_poses(model):
    travel = MotorTravel(model)
    for k in range(3):
        travel.add(MOTOR[k, ::-1], JOINT[k], UNHEARD)
    assert travel.suspicion() == ""


def test_samples_that_are_looked_at_again_add_no_pose(model):
    """Rare questions find the poses that many find: each second of the samples counts once."""
    stamps = (1e9 * (1.0 + TIME)).astype(np.int64).tolist()
    motor, joint = 0.02 * MOTOR, np.degrees(0.02 * JOINT)
    samples = [Sample(*one) for one in zip(stamps, motor, joint, strict=True)]
    often, once = MotorTravel(model), MotorTravel(model)
    for k in range(len(samples)):
        words = often.follow(samples[: k + 1], UNHEARD, whole=True)
    assert once.follow(samples, UNHEARD, whole=True) == words == said(model, motor, joint) != ""
    later = [one._replace(stamp_ns=one.stamp_ns + 1) for one in samples[:-1]]
    right = [one._replace(joint_angle=np.radians(one.joint_angle)) for one in later]
    assert once.follow([*samples, *right], UNHEARD, whole=True) == words
    once.forget()
    assert once.suspicion() == ""


def test_a_motor_of_several_drums_may_have_one_that_is_wrong():
    words = turn(load_model("prototype").robot, "winch", 1.3)
    assert words.endswith("would fit, or radius or winding of one of its drums")
