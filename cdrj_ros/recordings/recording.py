"""A bag as time series: measured inputs and references."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.messages.cdr import (
    FORCE_COMPONENTS,
    FORCE_VECTOR,
    JOINT_STATE,
    REFERENCE_ARRAYS,
    TEXT,
    MessageType,
)
from cdrj_ros.messages.topics import (
    EFFORTS,
    JOINT_STATES,
    MOTOR_STATES,
    NODAL_FORCES,
    TENSIONS,
    in_namespace,
)
from cdrj_ros.recordings.batch import LARGEST_REFERENCE, Batch, Channel, require_cdr
from cdrj_ros.recordings.decoding import BulkDecoder, series_by_name
from cdrj_ros.recordings.definitions import message_type
from cdrj_ros.recordings.mcap_file import McapFile
from cdrj_ros.recordings.source import Source, open_source

_MEASURED: Final = "measured/"
"""Prefix of the series of motor efforts among those of a topic."""

_VECTORS: Final = f"{FORCE_VECTOR}/"
"""Prefix of the channels of force vectors."""

NORM_DIFFERS: Final = 0.1
"""Share of the median magnitude of a recording by which magnitude and norm of the components may
differ in the median: both may be measured, each with its own noise."""


@dataclass(frozen=True)
class Topics:
    """Names of the topics to read."""

    motors: str = in_namespace(MOTOR_STATES)
    joints: str = in_namespace(JOINT_STATES)
    references: tuple[str, ...] = (
        f"/reference/{TENSIONS}",
        f"/reference/{NODAL_FORCES}",
        f"/reference/{EFFORTS}",
    )
    """Each carries CableTensions, NodalForces or JointState with efforts; all may be missing."""


@dataclass(frozen=True)
class Recording:
    """Time series of one bag."""

    path: Path
    start_ns: int
    """Log time [ns] of the earliest message read from the selected topics."""
    end_ns: int
    """Log time [ns] of the latest such message."""
    motors: Mapping[str, Series]
    """Motor angles by name [rad]."""
    joints: Mapping[str, Series]
    """Joint angles by name [rad]."""
    references: Mapping[str, Series]
    """`tension/upper/8` [N], `nodal_force/upper/3` (magnitude) [N], `effort/spindle` [N·m]; if they
    were asked for, also `force_vector/upper/3` [N], values of shape (n, 3), of the nodal forces
    that are given as vectors, see `force_vectors`."""
    malformed: Mapping[str, int]
    """Number of refused messages by topic: undecodable, or unequal numbers of values and names."""
    notes: tuple[str, ...]
    """Irregularities of the bag, as sentences."""
    motor_efforts: Mapping[str, Series] = field(default_factory=dict)
    """Efforts on the topic of motor angles by name [N·m]; empty unless they were asked for."""
    force_frame: str = ""
    """Frame that the messages with force vectors name; empty if they name none, which means that
    of each pulley by the definition of NodalForces."""


def read_recording(
    path: Path | str | Source,
    topics: Topics = Topics(),
    *,
    motor_efforts: bool = False,
    force_vectors: bool = False,
    effort_scale: Mapping[str, float] = MappingProxyType({}),
) -> Recording:
    """Read a rosbag2 folder or one MCAP file; it may be truncated or unindexed.

    If a message repeats a name, both values are kept.  With ``motor_efforts`` and
    ``force_vectors``, those are read too.  ``effort_scale`` has factors, by name,
    on the efforts that motors and joints publish with their angles; other efforts are in N m.
    Raises BagError.
    """
    source = path if isinstance(path, Source) else open_source(path)
    reading = _Reading(source, topics, motor_efforts, force_vectors, effort_scale)
    if source.channels_known():
        reading.require_inputs()
    first = 0
    for file in source.files:
        for batch in file.batches():
            reading.add(file, batch, first)
            first += len(batch.start)
    reading.require_inputs()
    return reading.recording()


@dataclass(frozen=True)
class _Role:
    """A use of one channel, as input or as reference."""

    topic: str
    is_input: bool
    prefix: str
    """Prefix of the names of its series."""
    decoder: BulkDecoder


class _Reading:
    """Decoders of the selected channels, each created at its channel's first message."""

    def __init__(
        self,
        source: Source,
        topics: Topics,
        motor_efforts: bool,
        force_vectors: bool,
        effort_scale: Mapping[str, float],
    ) -> None:
        self._source = source
        self._motor_efforts, self._force_vectors = motor_efforts, force_vectors
        self._effort_scale = effort_scale
        self._path = source.path
        self._topics = topics
        self._inputs = {topics.motors: "motor", topics.joints: "joint"}
        self._selected = {*self._inputs, *topics.references}
        self._roles: dict[Channel, tuple[_Role, ...]] = {}
        self._notes: list[str] = []

    def require_inputs(self) -> None:
        """Raise BagError if a topic of motor or joint angles is missing."""
        there = self._source.channels()
        for topic in self._inputs:
            if topic not in there:
                raise BagError(
                    f"{self._path} has no topic {topic}, but {', '.join(sorted(there)) or 'none'}; "
                    "name others with --motor-topic and --joint-topic"
                )

    def add(self, file: McapFile, batch: Batch, first: int) -> None:
        for number, channel in file.channels.items():
            if channel.topic not in self._selected:
                continue
            chosen = np.flatnonzero(batch.channel == number)
            if not len(chosen):
                continue
            if channel not in self._roles:
                self._roles[channel] = self._make(channel)
            for role in self._roles[channel]:
                role.decoder.add(batch, chosen, first)

    def recording(self) -> Recording:
        roles = [role for made in self._roles.values() for role in made]
        extents = [extent for role in roles if (extent := role.decoder.extent())]
        malformed = {role.topic: self._malformed(role.topic) for role in roles}
        motors_topic, joints_topic = self._topics.motors, self._topics.joints
        motors = self._series(motors_topic, is_input=True)
        joints = motors
        if joints_topic != motors_topic:
            joints = self._series(joints_topic, is_input=True)
        self._require_angles(motors, motors_topic, "motor")
        self._require_angles(joints, joints_topic, "joint")
        wanted = dict.fromkeys((motors_topic, *self._topics.references))
        others = {topic: self._series(topic, is_input=False) for topic in wanted}
        references, efforts = self._references(others), self._efforts(others[motors_topic])
        return Recording(
            path=self._path,
            start_ns=min(first for first, _ in extents),
            end_ns=max(last for _, last in extents),
            motors=motors,
            joints=joints,
            references=references,
            malformed=malformed,
            notes=(*self._source.all_notes(), *self._refusals(malformed), *self._notes),
            motor_efforts=efforts,
            force_frame=next((one.decoder.frame for one in roles if one.prefix == _VECTORS), ""),
        )

    def _efforts(self, found: Mapping[str, Series]) -> dict[str, Series]:
        """Efforts of the motors by name, without those that have no value at all."""
        return {
            name.removeprefix(_MEASURED): self._scaled(name.removeprefix(_MEASURED), series)
            for name, series in found.items()
            if name.startswith(_MEASURED) and series.stamp_ns.size
        }

    def _references(self, others: Mapping[str, Mapping[str, Series]]) -> dict[str, Series]:
        references: dict[str, Series] = {}
        for topic in dict.fromkeys(self._topics.references):
            for name, series in others[topic].items():
                if name.startswith(_MEASURED):
                    continue
                if name in references:
                    raise BagError(f"{self._path}: {name} is on several reference topics")
                if name.startswith(_VECTORS):
                    known, note = known_vectors(name, self._plausible(name, series))
                    self._notes += [note] if note else []
                    if known is not None:
                        references[name] = known
                else:
                    if topic in self._inputs:
                        series = self._scaled(name.partition("/")[2], series)  # noqa: PLW2901
                    references[name] = self._plausible(name, series)
        return references

    def _scaled(self, name: str, series: Series) -> Series:
        """The efforts [N m] of a motor or joint that has published them."""
        scale = self._effort_scale.get(name, 1.0)
        return series if scale == 1.0 else replace(series, value=scale * series.value)

    def _plausible(self, name: str, series: Series) -> Series:
        """The series with implausibly large values replaced by NaN."""
        beyond = np.isfinite(series.value) & (np.abs(series.value) > LARGEST_REFERENCE)
        if not beyond.any():
            return series
        self._notes.append(
            f"{name}: {int(beyond.sum())} values beyond {LARGEST_REFERENCE:g} were left out"
        )
        value = np.where(beyond, np.nan, series.value)
        value.flags.writeable = False
        return replace(series, value=value)

    def _series(self, topic: str, *, is_input: bool) -> dict[str, Series]:
        """The series of a topic by name; this empties the decoders."""
        by_prefix: dict[str, list[BulkDecoder]] = {}
        for made in self._roles.values():
            for role in made:
                if role.topic == topic and role.is_input == is_input:
                    by_prefix.setdefault(role.prefix, []).append(role.decoder)
        return {
            prefix + name: series
            for prefix, parts in by_prefix.items()
            for name, series in series_by_name(parts).items()
        }

    def _refusals(self, malformed: Mapping[str, int]) -> list[str]:
        """Sentences with the number of refused messages and the first reason, by topic."""
        return [
            f"{topic}: {count} malformed messages, the first: {self._first_refusal(topic)}"
            for topic, count in malformed.items()
            if count
        ]

    def _first_refusal(self, topic: str) -> str:
        reasons = [
            role.decoder.first_refusal
            for made in self._roles.values()
            for role in made
            if role.topic == topic and role.decoder.first_refusal
        ]
        return reasons[0] if reasons else ""

    def _require_angles(self, there: Mapping[str, Series], topic: str, kind: str) -> None:
        if there:
            return
        reason = ""
        if malformed := self._malformed(topic):
            first = self._first_refusal(topic)
            reason = f" ({malformed} malformed messages, the first: {first})"
        raise BagError(f"{self._path}: topic {topic} has no {kind} angles{reason}")

    def _malformed(self, topic: str) -> int:
        """Number of messages refused in any role; one refused in two roles counts once."""
        refused = [
            places
            for made in self._roles.values()
            for role in made
            if role.topic == topic
            for places in role.decoder.refused
        ]
        return int(np.unique(np.concatenate(refused)).size) if refused else 0

    def _make(self, channel: Channel) -> tuple[_Role, ...]:
        topic = channel.topic
        require_cdr(self._path, channel)
        wanted: list[tuple[bool, str, tuple[str, ...]]] = []
        if topic in self._inputs:
            if channel.msgtype != JOINT_STATE.name:
                raise self._wrong_type(channel, f"{self._inputs[topic]} angles", JOINT_STATE.name)
            wanted.append((True, "", ("position",)))
        if topic == self._topics.motors and self._motor_efforts:
            wanted.append((False, _MEASURED, ("effort",)))
        if topic in self._topics.references:
            if channel.msgtype not in REFERENCE_ARRAYS:
                raise self._wrong_type(channel, "references", " or ".join(REFERENCE_ARRAYS))
            prefix, array = REFERENCE_ARRAYS[channel.msgtype]
            wanted.append((False, prefix + "/", (array,)))
        try:
            message = message_type(channel.msgtype, channel.definition_encoding, channel.definition)
            if self._force_vectors and _has_components(message):
                wanted.append((False, _VECTORS, (*FORCE_COMPONENTS, "magnitude")))
            return tuple(
                _Role(topic, given, prefix, BulkDecoder(message, *arrays, may_be_empty=not given))
                for given, prefix, arrays in wanted
            )
        except BagError as error:
            raise BagError(f"{self._path}: topic {topic}: {error}") from None

    def _wrong_type(self, channel: Channel, use: str, expected: str) -> BagError:
        return BagError(
            f"{self._path}: topic {channel.topic} for {use} is "
            f"{channel.msgtype or 'of no type'}, expected {expected}"
        )


def _has_components(message: MessageType) -> bool:
    """Whether the bag's own definition of the message has the components of forces as arrays."""
    arrays = {one.name for one in message.fields if one.count is not None and one.code != TEXT}
    return arrays.issuperset(FORCE_COMPONENTS)


def known_vectors(name: str, series: Series) -> tuple[Series | None, str]:
    """The forces of one pulley as vectors; None if the recording has only their magnitudes.

    The components are a vector if their norm usually is the magnitude, as far as a magnitude is
    given.  A single force that disagrees is kept: the comparison shows it.  Components of zero
    beside a magnitude are not known: a sensor that measures only the magnitude writes them so.

    Args:
        name: of the channel, for the note.
        series: components and magnitude [N], shape (n, 4).

    Returns:
        The components [N], shape (n, 3), NaN where they are zero beside a magnitude; None if none
        is other than zero, or if they are no vector.  And a note on what was left out; empty if
        nothing was, or if all components are zero or unknown.
    """
    components = np.ascontiguousarray(series.value[:, :3])
    magnitude = series.value[:, 3]
    norm = np.linalg.norm(components, axis=1)
    present = np.isfinite(norm) & (norm > 0.0)
    if not present.any():
        return None, ""
    both = present & np.isfinite(magnitude)
    if both.any():
        difference = float(np.median(np.abs(norm[both] - magnitude[both])))
        if difference > NORM_DIFFERS * float(np.median(magnitude[both])):
            return None, (
                f"{name}: the norm of the components differs from the magnitude by "
                f"{difference:.3g} N in the median; only magnitudes were compared"
            )
    filled = (norm == 0.0) & (magnitude > 0.0)
    components[filled] = np.nan
    components.flags.writeable = False
    left_out = int(np.count_nonzero(filled))
    note = f"{name}: {left_out} forces with components of zero beside a magnitude were left out"
    return replace(series, value=components), note if left_out else ""
