"""Recordings of robots with joints without encoder: efforts as inputs, angles as references."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cdrj_ros.bag import Recording, Series, Topics, open_source, read_recording
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.conditioning.whole_recording import Conditioned, angles_of, condition
from cdrj_ros.estimation.estimator import Angles
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.judgement.channels import ANGLE
from cdrj_ros.model.channels import EFFORT
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot


def read_alone(path: str, topics: Topics, robot: Robot) -> Recording:
    """Read a bag for a robot with joints without encoder.

    The efforts of the motors are those on the topic of their angles or, where it has none, the
    recorded references, which are then inputs and not compared.  Recorded angles of the joints
    without encoder become references.

    Raises:
        BagError: as ``read_recording``, or no motor has an effort.
    """
    if not robot.as_read.joints and topics.joints not in open_source(path).channels():
        topics = replace(topics, joints=topics.motors)
    recording = read_recording(path, topics, motor_efforts=True, force_vectors=True)
    references, efforts = dict(recording.references), {}
    notes = list(recording.notes)
    for motor in robot.motors:
        reference = f"{EFFORT}/{motor.name}"
        if motor.name in recording.motor_efforts:
            efforts[motor.name] = recording.motor_efforts[motor.name]
        elif reference in references:
            efforts[motor.name] = references.pop(reference)
            notes.append(f"{reference} is an input here, and not compared.")
    unmeasured = [robot.joints[j].name for j in robot.unmeasured]
    if not efforts:
        raise BagError(
            f"{path} has no efforts of {', '.join(motor.name for motor in robot.motors)}, from "
            f"which {', '.join(unmeasured)} would be estimated"
        )
    joints = {name: one for name, one in recording.joints.items() if name not in unmeasured}
    for name in unmeasured:
        if name in recording.joints:
            references[f"{ANGLE}/{name}"] = angles_of(robot, name, recording.joints[name])
    return replace(
        recording, joints=joints, references=references, motor_efforts=efforts, notes=tuple(notes)
    )


def condition_alone(model: Model, recording: Recording) -> Conditioned:
    """As ``condition_recording``, without the joints that have no encoder."""
    robot = model.robot.as_read
    joints: Mapping[str, Series] = recording.joints
    if set(joints) <= set(recording.motors):
        joints = {joint.name: joints[joint.name] for joint in robot.joints}
    return condition(robot, recording.motors, joints)


def with_estimated_joints(robot: Robot, segment: Samples, angles: Sequence[Angles]) -> Samples:
    """A segment with the estimated angles of the joints without encoder, for drawing over them.

    Args:
        robot: the robot.
        segment: with the joints that have encoders.
        angles: estimated over the segment, one after another.
    """
    joint_angle = np.empty((segment.stamp_ns.size, len(robot.joints)))
    measured = [j for j, joint in enumerate(robot.joints) if joint.measured]
    joint_angle[:, measured] = segment.joint_angle
    for k, j in enumerate(robot.unmeasured):
        value = np.concatenate([one.value[:, k] for one in angles])
        joint_angle[:, j] = np.where(np.isfinite(value), value, robot.joints[j].reference_angle)
    return replace(segment, joint_angle=joint_angle)
