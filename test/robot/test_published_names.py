"""From what a stack publishes to angles and torques: names, prefix, gear, units, currents."""

import numpy as np
import pytest
from support.published import JOINT, MOTOR, NAMES, PLAIN, PUBLISHED, efforts, of_all

from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.identification.unknowns import parse_unknowns
from cdrj_ros.model.prepared import prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter
from cdrj_ros.robot.parameters import find_number, matching_paths
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.writer import with_numbers_in_text, with_section

STAMPS = 1_000_000_000 + 2_000_000 * np.arange(400)
TIME = (STAMPS - STAMPS[0]) * 1e-9
ANGLE = {"winch": 0.4 * np.sin(4.0 * TIME), "elbow": 0.5 * np.sin(4.0 * TIME + 0.1)}
TORQUE = 0.2 * np.cos(4.0 * TIME)


@pytest.fixture(scope="module")
def models():
    plain, published = (prepare(parse_robot(text, "robot")) for text in (PLAIN, PUBLISHED))
    return plain, published


def test_a_bag_gives_the_same_angles_and_torques_also_as_references(models, tmp_path):
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


def test_numbers_are_found_and_written_under_any_name():
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
    assert known.parameters[0] == f"{joint}.offset"
    (one,) = parse_unknowns(dict(robot.document), "effort_scale")
    assert one.paths == (f"{motor}.effort_scale",)


def test_a_written_entry_keeps_its_numbers_with_another_prefix():
    """As after a fit: a robot of the same kind is published as arm2."""
    stated = (
        f"uncertainty: {{parameters: ['motors.arm1_{MOTOR}.offset'], stddev: [0.01], "
        f"model_error: {{effort/arm1_{MOTOR}: 0.02}}}}"
    )
    text = with_section(PUBLISHED, "uncertainty", stated)
    known = parse_robot(text.replace("prefix: arm1_", "prefix: arm2_"), "robot").uncertainty
    assert known.parameters[0] == f"motors.arm2_{MOTOR}.offset"
    assert dict(known.model_error) == {f"effort/arm2_{MOTOR}": 0.02}
    assert parse_robot(text, "robot").uncertainty.parameters[0] == f"motors.arm1_{MOTOR}.offset"
