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
    STATES,
    TENSIONS,
    TRUTH,
    in_namespace,
)
from cdrj_ros.recordings.batch import (
    LARGEST_REFERENCE,
    Batch,
    BulkDecoder,
    Channel,
    require_cdr,
    series_by_name,
)
from cdrj_ros.recordings.definitions import message_type
from cdrj_ros.recordings.mcap_file import McapFile
from cdrj_ros.recordings.source import Source, open_source

_ANGLES, _MEASURED = "angles", "measured"
"""Uses of a topic that is an input: its positions, and its efforts."""

BY_ARRIVAL: Final = "header stamps are zero, so the log times are used"
"""End of the note on a topic whose log times replace stamps of zero."""

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
        in_namespace(f"{TRUTH}/{TENSIONS}"),
        in_namespace(f"{TRUTH}/{NODAL_FORCES}"),
        in_namespace(f"{TRUTH}/{STATES}"),
    )
    """Each carries CableTensions, NodalForces or JointState with efforts; all may be missing.  The
    last ones are those of the rig's node."""


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
    is_table: bool = False
    """Whether it is that of `read_table`: names may lack the robot's prefix, and efforts are as
    published."""


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
        self._source, self._path, self._topics = source, source.path, topics
        self._motor_efforts, self._force_vectors = motor_efforts, force_vectors
        self._effort_scale = effort_scale
        self._inputs = {topics.motors: "motor", topics.joints: "joint"}
        self._selected = {*self._inputs, *topics.references}
        self._of_channel: dict[Channel, list[BulkDecoder]] = {}
        self._of_use: dict[tuple[str, str], list[BulkDecoder]] = {}
        """By topic and use: what an input holds, or the prefix of references."""
        self._notes: list[str] = []

    def require_inputs(self) -> None:
        """Raise BagError if a topic of motor or joint angles is missing."""
        there = self._source.channels()
        for topic in self._inputs:
            if topic not in there:
                raise BagError(
                    f"{self._path} has no topic {topic}, but {', '.join(sorted(there))}; name "
                    "others with --motor-topic and --joint-topic"
                    if there
                    else f"{self._path} holds no messages"
                )

    def add(self, file: McapFile, batch: Batch, first: int) -> None:
        for number, channel in file.channels.items():
            if channel.topic not in self._selected:
                continue
            chosen = np.flatnonzero(batch.channel == number)
            if not len(chosen):
                continue
            if channel not in self._of_channel:
                self._of_channel[channel] = self._make(channel)
            for decoder in self._of_channel[channel]:
                decoder.add(batch, chosen, first)

    def recording(self) -> Recording:
        decoders = [one for made in self._of_channel.values() for one in made]
        self._note_stamps()
        extents = [extent for one in decoders if (extent := one.extent())]
        refused = {topic: self._refused(topic) for topic, _ in self._of_use}
        for topic, (count, reason) in refused.items():
            if count:
                self._notes.append(f"{topic}: {count} malformed messages, the first: {reason}")
        motors = self._angles(self._topics.motors)
        same = self._topics.joints == self._topics.motors
        joints = motors if same else self._angles(self._topics.joints)
        measured = self._series(self._topics.motors, _MEASURED)
        return Recording(
            path=self._path,
            start_ns=min(first for first, _ in extents),
            end_ns=max(last for _, last in extents),
            motors=motors,
            joints=joints,
            references=self._references(),
            malformed={topic: count for topic, (count, _) in refused.items()},
            notes=(*self._source.all_notes(), *self._notes),
            motor_efforts={
                name: self._scaled(name, one) for name, one in measured.items() if one.stamp_ns.size
            },
            force_frame=next(
                (one.frame for (_, use), made in self._of_use.items() for one in made
                 if use == FORCE_VECTOR), "",
            ),
        )  # fmt: skip

    def _note_stamps(self) -> None:
        """Name the topics whose log times replace stamps of zero."""
        unstamped = {
            topic
            for (topic, _), made in self._of_use.items()
            if any(table.by_arrival for one in made for table in one.tables.values())
        }
        self._notes += [f"{topic}: {BY_ARRIVAL}" for topic in sorted(unstamped)]

    def _series(self, topic: str, use: str) -> dict[str, Series]:
        """The series of a topic by name; this empties the decoders."""
        return series_by_name(self._of_use.get((topic, use), ()))

    def _angles(self, topic: str) -> dict[str, Series]:
        if found := self._series(topic, _ANGLES):
            return found
        count, first = self._refused(topic)
        reason = f" ({count} malformed messages, the first: {first})" if count else ""
        kind = self._inputs[topic]
        raise BagError(f"{self._path}: topic {topic} has no {kind} angles{reason}")

    def _references(self) -> dict[str, Series]:
        references: dict[str, Series] = {}
        for topic, use in self._of_use:
            if use in (_ANGLES, _MEASURED):
                continue
            for name, found in self._series(topic, use).items():
                channel = f"{use}/{name}"
                if channel in references:
                    raise BagError(f"{self._path}: {channel} is on several reference topics")
                own = self._scaled(name, found) if topic in self._inputs else found
                series: Series | None = self._plausible(channel, own)
                if use == FORCE_VECTOR and series is not None:
                    series, note = known_vectors(channel, series)
                    self._notes += [note] if note else []
                if series is not None:
                    references[channel] = series
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

    def _refused(self, topic: str) -> tuple[int, str]:
        """Number of messages refused in any use, each counted once, and the first reason."""
        of_topic = [
            one for (name, _), made in self._of_use.items() if name == topic for one in made
        ]
        places = [refused for one in of_topic for refused in one.refused]
        count = int(np.unique(np.concatenate(places)).size) if places else 0
        return count, next((one.first_refusal for one in of_topic if one.first_refusal), "")

    def _make(self, channel: Channel) -> list[BulkDecoder]:
        topic, kind = channel.topic, channel.msgtype
        require_cdr(self._path, channel)
        wanted: list[tuple[str, tuple[str, ...]]] = []
        if topic in self._inputs:
            if kind != JOINT_STATE.name:
                raise self._wrong_type(channel, f"{self._inputs[topic]} angles", JOINT_STATE.name)
            wanted.append((_ANGLES, ("position",)))
        if topic == self._topics.motors and self._motor_efforts:
            wanted.append((_MEASURED, ("effort",)))
        if topic in self._topics.references:
            if kind not in REFERENCE_ARRAYS:
                raise self._wrong_type(channel, "references", " or ".join(REFERENCE_ARRAYS))
            prefix, array = REFERENCE_ARRAYS[kind]
            wanted.append((prefix, (array,)))
        try:
            message = message_type(kind, channel.definition_encoding, channel.definition)
            if self._force_vectors and _has_components(message):
                wanted.append((FORCE_VECTOR, (*FORCE_COMPONENTS, "magnitude")))
            made = []
            for use, arrays in wanted:
                made.append(BulkDecoder(message, *arrays, may_be_empty=True))
                self._of_use.setdefault((topic, use), []).append(made[-1])
        except BagError as error:
            raise BagError(f"{self._path}: topic {topic}: {error}") from None
        return made

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
