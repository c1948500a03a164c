"""The inputs and references of a recording: read, checked, conditioned, cut into passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from cdrj_ros.estimation.conditioner import (
    Conditioned,
    angles_of,
    condition,
    count_of,
    worth_of,
)
from cdrj_ros.estimation.estimator import Angles, Samples
from cdrj_ros.estimation.refusals import NOTED, refusal_words, sparse_words
from cdrj_ros.estimation.travel import travel_suspicion
from cdrj_ros.evaluation.channels import ANGLE, FORCE_VECTOR
from cdrj_ros.foundation.arrays import Series, Stamps
from cdrj_ros.foundation.errors import BagError, nearest
from cdrj_ros.foundation.output import printable
from cdrj_ros.messages import topics as standard
from cdrj_ros.messages.cdr import REFERENCE_ARRAYS
from cdrj_ros.model.packing import EFFORT, TENSION
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.recording import Recording, Topics, read_recording
from cdrj_ros.recordings.source import open_source
from cdrj_ros.recordings.table import Columns, table_with
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.names import known_name, naming_hint


def read_inputs(
    bag: str | Recording,
    topics: Topics | Columns,
    model: Model,
    *,
    motor_efforts: bool = False,
    force_vectors: bool = False,
    whole: bool = True,
) -> Recording:
    """Read a bag or a table that was not read yet, and check that it has all axes of a robot.

    Without ``whole``, those of one cable are enough, and a note names the others.

    Raises:
        BagError: as ``read_recording``, or a motor or joint of the robot is missing.
    """
    if isinstance(bag, Recording):
        path, recording = str(bag.path), of_robot(bag, model.robot)
    else:
        path, recording = bag, _read(bag, topics, model.robot, motor_efforts, force_vectors)
    missing = missing_axes(path, recording, model.robot)
    there = recording.motors.keys() | recording.joints.keys()
    unread = [axis.name not in there for axis in model.robot.axes]
    if missing and (whole or model.touched[unread].any(axis=0).all()):
        raise BagError(missing)
    notes = [f"{missing}. Its cables have no estimate."] if missing else []
    return replace(recording, notes=(*recording.notes, *notes))


def _read(
    path: str, topics: Topics | Columns, robot: Robot, motor_efforts: bool, force_vectors: bool
) -> Recording:
    """Read a bag with the references that it has, or a table."""
    if isinstance(topics, Columns):
        return of_robot(table_with(path, topics), robot)
    if not robot.motors:  # of passive cables alone
        topics = replace(topics, motors=topics.joints)
    return read_recording(
        path, topics, motor_efforts=motor_efforts, force_vectors=force_vectors,
        effort_scale=robot.effort_scale,
    )  # fmt: skip


def of_robot(recording: Recording, robot: Robot) -> Recording:
    """A recording with the robot's names, and with efforts in N m; that of a bag as it is.

    Names of motors and joints may lack the prefix of the robot file.

    Raises:
        BagError: a table has a reference of something that the robot does not have.
    """
    if not recording.is_table:
        return recording
    own, document = {axis.name for axis in robot.axes}, dict(robot.document)

    def renamed(readings: Mapping[str, Series]) -> dict[str, Series]:
        return {known_name(n, own, document): one for n, one in readings.items()}

    efforts = {
        name: replace(one, value=robot.effort_scale.get(name, 1.0) * one.value)
        for name, one in renamed(recording.motor_efforts).items()
    }
    references = {
        name: one for name, one in recording.references.items() if not name.startswith(f"{EFFORT}/")
    }
    elements = [name for cable in robot.cables for name in cable.element_names]
    tensions = [n.removeprefix(f"{TENSION}/") for n in references if n.startswith(f"{TENSION}/")]
    for kind, names, there in (("element", tensions, elements), ("axis", efforts, sorted(own))):
        for name in names:
            if name not in there:
                absent = f"there is no {kind} {printable(name)}; {nearest(name, there)}"
                raise BagError(f"{recording.path}: {absent}")
    return replace(
        recording,
        motors=renamed(recording.motors),
        joints=renamed(recording.joints),
        references=references | {f"{EFFORT}/{name}": one for name, one in efforts.items()},
        motor_efforts=efforts,
    )


def missing_axes(path: str, recording: Recording, robot: Robot) -> str:
    """Motors or joints that a recording lacks, and those that it has, in words; or empty."""
    for kind, wanted, there in (
        ("motor", robot.motors, recording.motors),
        ("joint", robot.joints, recording.joints),
    ):
        missing = [axis.name for axis in wanted if axis.name not in there]
        if missing:
            hint = naming_hint(sorted(there), missing, robot.document)
            return (
                f"{path} has no {kind} named {', '.join(missing)}; "
                f"it has {'; '.join(filter(None, (', '.join(sorted(there)) or 'none', hint)))}"
            )
    return ""


def condition_recording(model: Model, recording: Recording) -> Conditioned:
    """Pass the recording's readings through the gates that the node uses.

    If motors and joints share a topic, an unknown name is counted only once.  The samples have no
    joints without encoder.  Where the clock went back, they are those of the longest segment.
    """
    robot = model.robot
    joints: Mapping[str, Series] = recording.joints
    if joints.keys() <= recording.motors.keys():
        names = (joint.name for joint in robot.as_read.joints)
        joints = {name: joints[name] for name in names if name in joints}
    found = condition(robot, recording.motors, joints)
    return replace(
        found, segments=tuple(sorted(found.segments, key=lambda one: -one.stamp_ns.size)[:1])
    )


MISFIT: Final = "Readings do not fit the robot file: "
"""Beginning of the note on what may be wrong with which axis."""

MANY: Final = 0.01
"""Share of the readings, refused by their values, from which axes and remedy are named."""

SELDOM: Final = 0.9
"""Share of the samples whose uncertainty between readings counts as that of the motion."""


def doubts_of(model: Model, conditioned: Conditioned) -> list[str]:
    """Notes on units, gears, names and ranges that do not fit the file, and on sparse readings."""
    notes, robot = [], model.robot
    for one in conditioned.segments:
        whole = one.whole()
        words = travel_suspicion(model, whole.motor_angle, whole.joint_angle)
        if words:
            notes.append(f"{MISFIT}{words}.")
        if len(one.unseen) > 1 and not robot.unmeasured:
            midway = np.quantile(one.unseen[:, 1], SELDOM, axis=0, method="lower")
            rate_hz = 1e9 / float(np.median(np.diff(one.stamp_ns)))
            if words := sparse_words(robot, worth_of(robot), midway, rate_hz):
                notes.append(f"{words}.")
    by_value = {
        cause: conditioned.refused.get(cause, 0) for cause in ("out_of_range", "implausible")
    }
    if sum(by_value.values()) > MANY * conditioned.accepted:
        notes.append(f"{refusal_words(by_value, conditioned.sizes, robot)}.")
    return notes


def unstated_counts(model: Model, recording: Recording) -> list[str]:
    """Notes on encoders whose counts are worth much, and whose resolution the file leaves out."""
    robot, notes = model.robot, []
    if robot.unmeasured:
        return []
    readings = {**recording.motors, **recording.joints}
    for axis, tenth in zip(robot.axes, worth_of(robot), strict=True):
        count = count_of(readings[axis.name].value) if axis.name in readings else 0.0
        share = 0.1 * abs(axis.sensor.scale) * count / tenth
        if axis.sensor.resolution == 0.0 and share > NOTED:
            notes.append(
                f"{axis.name} is read in counts of {count:.3g}, each worth {share:.0%} of a "
                "preload; state its resolution, and a tracking_bandwidth to filter between them."
            )
    return notes


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


def read_encoderless(bag: str | Recording, topics: Topics | Columns, robot: Robot) -> Recording:
    """Read a bag, unless that is done, for a robot with joints without encoder.

    The efforts of the motors are those on the topic of their angles or, where it has none, the
    recorded references, which are then inputs and not compared.  Recorded angles of the joints
    without encoder become references.

    Raises:
        BagError: as ``read_inputs``, or no motor has an effort.
    """
    if isinstance(bag, Recording):
        path, recording = str(bag.path), of_robot(bag, robot)
    else:
        path = bag
        if (
            isinstance(topics, Topics)
            and not robot.as_read.joints
            and topics.joints not in open_source(path).channels()
        ):
            topics = replace(topics, joints=topics.motors)
        recording = _read(path, topics, robot, True, True)
    found = _encoderless(path, recording, robot)
    if missing := missing_axes(path, found, robot.as_read):
        raise BagError(missing)
    return found


def _encoderless(path: str, recording: Recording, robot: Robot) -> Recording:
    """The recording with efforts as inputs, and with recorded angles without encoder compared."""
    references, efforts = dict(recording.references), {}
    notes = list(recording.notes)
    for motor in robot.motors:
        reference = f"{EFFORT}/{motor.name}"
        if motor.name in recording.motor_efforts:
            efforts[motor.name] = recording.motor_efforts[motor.name]
            if recording.is_table:
                del references[reference]
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


WHOLE: Final = (0.0, float("inf"))
"""The window that covers a whole recording [s]."""

_MALFORMED: Final = " malformed messages, the first: "
"""Part of the notes on topics whose messages were refused."""

_NO_REFERENCES: Final = (
    standard.MOTOR_STATES,
    standard.JOINT_STATES,
    standard.TENSIONS,
    standard.NODAL_FORCES,
    standard.EFFORTS,
    standard.TENSION_STATES,
    standard.JOINT_ANGLES,
    standard.TENSION_SENSORS,
)
"""Topics that the estimator hears or publishes."""

Window = tuple[float, float]
"""Begin and end of the compared references, relative to the start of the recording [s]."""


def require_references(path: str, topics: Topics | Columns, recording: Recording) -> None:
    """Refuse a recording without references.

    Raises:
        BagError: it has none; the message lists the topics that may have them.
    """
    if recording.references:
        return
    if isinstance(topics, Columns) or recording.is_table:
        raise BagError(f"{path} holds no references; name columns of tensions or efforts")
    if refused := [note for note in recording.notes if _MALFORMED in note]:
        raise BagError(f"{path} holds no references; {'; '.join(refused)}")
    own = (topics.motors, topics.joints, *map(standard.in_namespace, _NO_REFERENCES))
    listed = ", ".join(
        f"{printable(name)} ({channel.msgtype.rpartition('/')[2]})"
        for name, channel in sorted(open_source(recording.path).channels().items())
        if channel.msgtype in REFERENCE_ARRAYS and not name.endswith(own)
    )
    raise BagError(
        f"{path} holds no references; name their topics with --reference (CableTensions, "
        f"NodalForces, or JointState with efforts), of which it has {listed or 'no other'}; "
        f"efforts that the motors publish themselves: --reference {topics.motors}"
    )


def references_in(
    model: Model, path: str, recording: Recording, conditioned: Conditioned, window: Window
) -> Mapping[str, Series]:
    """The references within a window, by channel.

    Raises:
        BagError: there is nothing to compare.
    """
    references = _windowed(recording, window)
    if not references:
        raise BagError(f"{path} holds no references in that time")
    require_samples(path, model.robot, conditioned)
    return references


def require_samples(path: str | Path, robot: Robot, conditioned: Conditioned) -> None:
    """Refuse a recording without a time at which every motor and joint is known.

    Raises:
        BagError: with the reason.
    """
    if not conditioned.segments:
        why = conditioned.shortage(robot) or "no time lies within the readings of all of them"
        raise BagError(f"{path}: not one sample of all motors and joints was acceptable: {why}")


def in_frames_of(robot: Robot, recording: Recording) -> Recording:
    """The recording, with a note in place of the force vectors in another frame than the estimates.

    The estimated forces of a cable without positions are in each pulley's own frame, and cannot be
    compared with those in a frame that the messages name.  For a cable with positions both are
    taken to be in the base frame, also where the messages name no frame or another.
    """
    unplaced = [cable.name for cable in robot.cables if not cable.placed]
    starts = tuple(f"{FORCE_VECTOR}/{cable}/" for cable in unplaced)
    foreign = {name for name in recording.references if name.startswith(starts)}
    mixed = len(unplaced) < len(robot.cables) and recording.force_frame == robot.base_link
    if not foreign or not recording.force_frame or mixed:
        return recording
    note = (
        f"The recorded forces are in the frame {printable(recording.force_frame)}, but the robot "
        f"file gives no positions of {', '.join(unplaced)}: only magnitudes were compared."
    )
    return replace(
        recording,
        references={n: one for n, one in recording.references.items() if n not in foreign},
        notes=(*recording.notes, note),
    )


def _windowed(recording: Recording, window: Window) -> Mapping[str, Series]:
    """The references within the window, without channels that have no sample in it."""
    begin, end = window
    if window == WHOLE:
        return recording.references
    kept = {}
    for name, series in recording.references.items():
        since = (series.log_ns - recording.start_ns) * 1e-9
        inside = (since >= begin) & (since < end)
        if inside.any():
            kept[name] = series.part(inside)
    return kept


def duration_s(recording: Recording, window: Window) -> float:
    """Duration of the part of a recording within a window [s]."""
    begin, end = window
    length = (recording.end_ns - recording.start_ns) * 1e-9
    return max(min(length, end) - begin, 0.0)


def nothing_beside(estimated: Stamps, references: Mapping[str, Series]) -> str:
    """Why no reference has an estimate beside it, in words; both have at least one stamp."""
    known = [one.stamp_ns for one in references.values() if one.stamp_ns.size]
    begin_s = 1e-9 * (min(one.min() for one in known) - estimated[0])
    end_s = 1e-9 * (max(one.max() for one in known) - estimated[-1])
    return (
        "no reference value has an estimate beside it; by their stamps the references begin "
        f"{begin_s:.3f} s and end {end_s:.3f} s after the estimates: are they of one clock?"
    )


def in_order(readings: Mapping[str, Series], conditioned: Conditioned) -> Mapping[str, Series]:
    """Series in order of stamps where the clock went back; of equal stamps the first counts."""
    if not conditioned.clock_jumps:
        return readings
    ordered = {}
    for name, series in readings.items():
        _, first = np.unique(series.stamp_ns, return_index=True)
        ordered[name] = series.part(first)
    return ordered
