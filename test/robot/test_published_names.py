"""From what a stack publishes to angles and torques: names, prefix, gear, units, currents."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.published import JOINT, MOTOR, NAMES, PLAIN, PUBLISHED, efforts, of_all, positions

from cdrj_ros.commands.check_robot_text import mapping
from cdrj_ros.estimation.reading_limits import efforts_of
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.identification.unknowns import parse_unknowns
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.parameters import find_number, matching_paths
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.writer import with_numbers_in_text, with_section
from cdrj_ros.view.history import joint_angles, joint_axes

STAMPS = 1_000_000_000 + 2_000_000 * np.arange(400)
TIME = (STAMPS - STAMPS[0]) * 1e-9
ANGLE = {"winch": 0.4 * np.sin(4.0 * TIME), "elbow": 0.5 * np.sin(4.0 * TIME + 0.1)}
TORQUE = 0.2 * np.cos(4.0 * TIME)


@pytest.fixture(scope="module")
def models() -> tuple[Model, Model]:
    plain, published = (prepare(parse_robot(text, "robot")) for text in (PLAIN, PUBLISHED))
    return plain, published


def test_the_live_estimate_is_that_of_angles_and_torques(models: tuple[Model, Model]) -> None:
    plain, published = (LiveEstimator(model, Options()) for model in models)
    for k, stamp in enumerate(STAMPS.tolist()):
        angles = [ANGLE["winch"][k], ANGLE["elbow"][k]]
        ours = plain.conditioner.feed_both(stamp, ("winch", "elbow"), angles)
        theirs = published.conditioner.feed_both(stamp, NAMES, positions(*angles))
        assert len(ours) == len(theirs)
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(one.motor_angle, other.motor_angle, atol=1e-9)
            np.testing.assert_allclose(one.joint_angle, other.joint_angle, atol=1e-9)
    torques = efforts_of(models[1].robot, NAMES, np.array(efforts(TORQUE[0])))
    np.testing.assert_allclose(torques, [7.0, 7.0, 7.0, 7.0, TORQUE[0]])
    assert efforts_of(models[1].robot, NAMES, np.zeros(2)).size == 0


def test_a_bag_gives_the_same_angles_and_torques_also_as_references(
    models: tuple[Model, Model], tmp_path: Path
) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states(
            "/joint_states", STAMPS, NAMES, position=of_all(ANGLE["winch"], ANGLE["elbow"]),
            effort=[efforts(torque) for torque in TORQUE.tolist()],
        )  # fmt: skip
        bag.write_joint_states("/measured", STAMPS, ("sensor",), effort=TORQUE[:, None])
    topics = Topics("/joint_states", "/joint_states", ("/joint_states", "/measured"))
    model, motor = models[1], f"arm1_{MOTOR}"
    recording = read_inputs(str(tmp_path / "bag"), topics, model, motor_efforts=True)
    np.testing.assert_allclose(recording.motor_efforts[motor].value, TORQUE)
    np.testing.assert_allclose(recording.references[f"effort/{motor}"].value, TORQUE)
    np.testing.assert_allclose(recording.references["effort/sensor"].value, TORQUE)
    (segment,) = condition_recording(model, recording).segments
    inside = slice(5, -5)
    for angle, name in ((segment.motor_angle, "winch"), (segment.joint_angle, "elbow")):
        expected = np.interp(segment.stamp_ns, STAMPS, ANGLE[name])
        np.testing.assert_allclose(angle[inside, 0], expected[inside], atol=2e-4)  # half a count


def test_a_picture_shows_the_same_angle(models: tuple[Model, Model]) -> None:
    message = SimpleNamespace(
        name=NAMES, position=positions(ANGLE["winch"][30], ANGLE["elbow"][30])
    )
    axes = joint_axes(models[1].robot)
    assert joint_angles(message, axes, np.zeros(1)) == pytest.approx(ANGLE["elbow"][30])


def test_check_robot_shows_what_published_numbers_mean(models: tuple[Model, Model]) -> None:
    assert list(mapping(models[0].robot)) == []
    motor, joint = mapping(models[1].robot)
    assert motor.startswith(f"arm1_{MOTOR}: angle [rad] = -3.06796e-05 * published +0.3, ")
    assert motor.endswith(", effort [N m] = 2.7 * published")
    assert joint == f"arm1_{JOINT}: angle [rad] = 6.28319 * published -0.1"


def test_numbers_are_found_and_written_under_any_name() -> None:
    robot = parse_robot(PUBLISHED, "robot")
    motor, joint = f"motors.arm1_{MOTOR}", f"joints.arm1_{JOINT}"
    assert find_number(dict(robot.document), f"{joint}.offset").value == -0.1
    assert matching_paths(dict(robot.document), f"{motor}.scale") == ((f"{motor}.scale",),)
    text = with_numbers_in_text(
        PUBLISHED, {f"{motor}.offset": 0.25, f"{joint}.clock_offset": 1e-3}, "robot"
    )
    changed = parse_robot(text, "robot")
    assert changed.motors[0].sensor.offset == 0.25
    assert changed.joints[0].sensor.clock_offset_ns == 1_000_000
    stated = f"uncertainty: {{parameters: ['joints.{JOINT}.offset'], stddev: [0.01]}}\n"
    known = parse_robot(with_section(text, "uncertainty", stated), "robot").uncertainty
    assert known is not None
    assert known.parameters[0] == f"{joint}.offset"
    (one,) = parse_unknowns(dict(robot.document), "effort_scale")
    assert one.paths == (f"{motor}.effort_scale",)


@pytest.mark.parametrize(
    ("before", "after", "answer"),
    [
        (
            "- name: winch",
            "- name: winch\n    gear_ratio: 50",
            r"motors\[0\].gear_ratio .*scale: 1/N",
        ),
        ("mu_c: 0.15", "torque_constant: 0.06", r"friction.torque_constant .*effort_scale"),
        ("name: prototype", "name: prototype\ncounts_per_turn: 4096", "scale_deg: 360"),
        ("- name: winch", "- name: winch\n    effort_scale: 0", "effort_scale must not be 0"),
        ("- name: winch", "- name: '[a]'", "a name of letters, digits, inner spaces"),
        ("name: elbow", "name: upper/1", "is that of an element"),
    ],
)
def test_a_key_of_another_program_is_answered_with_ours(
    before: str, after: str, answer: str
) -> None:
    with pytest.raises(RobotFileError, match=answer):
        parse_robot(
            PLAIN.replace(before, after, 1).replace(
                "joint: elbow", f"joint: {after[6:]}" if "upper" in after else "joint: elbow"
            ),
            "robot",
        )
