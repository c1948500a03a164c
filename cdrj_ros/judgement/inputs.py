"""The inputs of a recording: its angles, checked, conditioned and counted."""

from __future__ import annotations

from cdrj_ros.bag import Recording, Topics, read_recording
from cdrj_ros.conditioning.whole_recording import Conditioned, condition
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot


def read_inputs(
    path: str,
    topics: Topics,
    model: Model,
    *,
    motor_efforts: bool = False,
    force_vectors: bool = False,
) -> Recording:
    """Read a bag and check that it has all motors and joints of a robot.

    Raises:
        BagError: as ``read_recording``, or a motor or joint of the robot is missing.
    """
    recording = read_recording(
        path, topics, motor_efforts=motor_efforts, force_vectors=force_vectors
    )
    require_axes(path, recording, model.robot)
    return recording


def require_axes(path: str, recording: Recording, robot: Robot) -> None:
    """Refuse a recording without the angles of a motor or joint.

    Raises:
        BagError: with the missing names, and the names that the recording has.
    """
    for kind, wanted, there in (
        ("motor", robot.motors, recording.motors),
        ("joint", robot.joints, recording.joints),
    ):
        missing = [axis.name for axis in wanted if axis.name not in there]
        if missing:
            raise BagError(
                f"{path} has no {kind} named {', '.join(missing)}; "
                f"it has {', '.join(sorted(there)) or 'none'}"
            )


def condition_recording(model: Model, recording: Recording) -> Conditioned:
    """Pass the recording's readings through the gates that the node uses.

    If motors and joints share a topic, an unknown name is counted only once.
    """
    joints = recording.joints
    if set(joints) == set(recording.motors):
        joints = {name: joints[name] for name in model.layout.joints}
    return condition(model.robot, recording.motors, joints)


def counters_of(recording: Recording, conditioned: Conditioned) -> dict[str, int]:
    """Number of refused readings by cause, and of clock jumps, gaps and steps, without zeros."""
    counts = {cause: n for cause, n in conditioned.refused.items() if n}
    malformed = sum(recording.malformed.values())
    if malformed:
        counts["malformed"] = counts.get("malformed", 0) + malformed
    if conditioned.clock_jumps:
        counts["clock_jumps"] = conditioned.clock_jumps
    if conditioned.gaps:
        counts["gaps"] = conditioned.gaps
    if conditioned.steps:
        counts["stepped_readings"] = conditioned.steps
    return counts
