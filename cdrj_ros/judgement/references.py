"""The references of a recording that estimates are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from cdrj_ros.bag import Recording, Series, Topics
from cdrj_ros.bag.source import open_source
from cdrj_ros.conditioning.whole_recording import Conditioned
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.text import printable
from cdrj_ros.judgement.channels import FORCE_VECTOR
from cdrj_ros.robot.description import Robot

WHOLE: Final = (0.0, float("inf"))
"""The window that covers a whole recording [s]."""

Window = tuple[float, float]
"""Begin and end of the compared references, relative to the start of the recording [s]."""


def require_reference_topics(path: str, topics: Topics) -> None:
    """Refuse a bag without reference topics before reading it, if its index lists the topics.

    Raises:
        BagError: there is no reference topic, or the bag cannot be opened.
    """
    source = open_source(path)
    there = source.channels()
    known = source.channels_known() and {topics.motors, topics.joints} <= set(there)
    if known and not set(topics.references).intersection(there):
        raise _no_references(path)


def references_in(
    path: str, recording: Recording, conditioned: Conditioned, window: Window
) -> Mapping[str, Series]:
    """The references within a window, by channel.

    Raises:
        BagError: there is nothing to compare.
    """
    references = _windowed(recording, window)
    if not references:
        raise _no_references(path, recording)
    if not any(segment.stamp_ns.size for segment in conditioned.segments):
        raise BagError(f"{path}: not one sample of all motors and joints was acceptable")
    return references


def in_frames_of(robot: Robot, recording: Recording) -> Recording:
    """The recording, with a note in place of the force vectors in another frame than the estimates.

    The estimated forces of a cable without positions are in each pulley's own frame, and cannot be
    compared with those in a frame that the messages name.  For a cable with positions both are
    taken to be in the base frame, also where the messages name no frame or another.
    """
    unplaced = [cable.name for cable in robot.cables if not (cable.routed or cable.spatial)]
    starts = tuple(f"{FORCE_VECTOR}/{cable}/" for cable in unplaced)
    foreign = {name for name in recording.references if name.startswith(starts)}
    if not foreign or not recording.force_frame:
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
            kept[name] = Series(
                series.stamp_ns[inside], series.log_ns[inside], series.value[inside]
            )
    return kept


def duration_s(recording: Recording, window: Window) -> float:
    """Duration of the part of a recording within a window [s]."""
    begin, end = window
    length = (recording.end_ns - recording.start_ns) * 1e-9
    return max(min(length, end) - begin, 0.0)


def _no_references(path: str, recording: Recording | None = None) -> BagError:
    when = " in that time" if recording is not None and recording.references else ""
    notes = () if recording is None else recording.notes
    refused = "; ".join(note for note in notes if " malformed messages, the first: " in note)
    advice = "name their topics with --reference (CableTensions, NodalForces, or JointState with "
    return BagError(f"{path} holds no references{when}; {refused or advice + 'efforts)'}")
