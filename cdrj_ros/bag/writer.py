"""Write a rosbag2 folder: metadata.yaml and one MCAP file, for every reader of such bags."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mcap import records

from cdrj_ros.bag.bulk import plain_payloads
from cdrj_ros.bag.definitions import long_name, message_type, own_definition, parse_definition
from cdrj_ros.bag.mcap_file import MESSAGE_HEAD, Channel, Int64s, Octets, pick
from cdrj_ros.bag.mcap_writing import COMPRESSIONS, Block, write_file
from cdrj_ros.bag.metadata import OFFERED_QOS, WrittenTopic, information, metadata_file
from cdrj_ros.bag.recording import require_cdr
from cdrj_ros.bag.source import METADATA, open_source
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES, Template

_CHUNK_BYTES: Final = 1 << 20

ArrayLike = npt.ArrayLike


@dataclass(frozen=True)
class _Encoded:
    """Messages whose bytes are made when the file is written."""

    channel: int
    log_ns: Int64s
    arrival: Int64s
    stamp_ns: Int64s
    template: Template
    arrays: Mapping[str, npt.NDArray[Any]]

    @property
    def length(self) -> int:
        return len(self.template.payload)

    def rows(self, first: int, last: int) -> Octets:
        arrays = {name: values[first:last] for name, values in self.arrays.items()}
        return self.template.encode_many(self.stamp_ns[first:last], arrays, MESSAGE_HEAD)


@dataclass(frozen=True)
class _Copied:
    """Messages that came as bytes, shape (n, MESSAGE_HEAD + length)."""

    channel: int
    log_ns: Int64s
    arrival: Int64s
    data: Octets

    @property
    def length(self) -> int:
        return int(self.data.shape[1]) - MESSAGE_HEAD

    def rows(self, first: int, last: int) -> Octets:
        rows: Octets = self.data[first:last].copy()
        return rows


class BagWriter:
    """Collects messages and writes them, in order of log time, when closed.

    A context manager; nothing is left behind where its body raises.  Every `write_…` may be called
    repeatedly for a topic.  `log_ns` is when each message counts as recorded; None: at its stamp.
    """

    def __init__(
        self, path: Path | str, *, compression: str = "zstd", chunk_bytes: int = _CHUNK_BYTES
    ) -> None:
        """`path` is the folder to be made; `compression` of the chunks is zstd, lz4 or empty."""
        self.path = Path(path)
        if self.path.exists():
            raise BagError(f"{self.path} exists already; a bag is written to a new folder")
        if compression not in COMPRESSIONS:
            raise BagError(f"compression must be one of {COMPRESSIONS}, got {compression!r}")
        self._compression = compression
        self._chunk_bytes = chunk_bytes
        self._schemas: dict[tuple[str, str, str], records.Schema] = {}
        self._channels: dict[str, records.Channel] = {}
        self._declared: dict[str, Channel] = {}
        self._blocks: list[Block] = []
        self._arrived = 0
        self._closed = False

    def __enter__(self) -> BagWriter:
        """Nothing is written yet."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write the bag, unless the body raised."""
        if kind is None:
            self.close()
        self._closed = True

    def write_joint_states(
        self,
        topic: str,
        stamp_ns: ArrayLike,
        names: Sequence[str],
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        effort: ArrayLike | None = None,
        *,
        log_ns: ArrayLike | None = None,
        frame_id: str = "",
    ) -> None:
        """sensor_msgs/JointState; stamps (n,), arrays (n, len(names)); None is sent as empty."""
        arrays = {"position": position, "velocity": velocity, "effort": effort}
        self._write(JOINT_STATE.name, topic, stamp_ns, names, arrays, log_ns, frame_id)

    def write_tensions(
        self,
        topic: str,
        stamp_ns: ArrayLike,
        names: Sequence[str],
        tension: ArrayLike,
        stddev: ArrayLike | None = None,
        status: ArrayLike | None = None,
        *,
        log_ns: ArrayLike | None = None,
        frame_id: str = "",
    ) -> None:
        """cdrj_msgs/CableTensions [N]; stamps (n,), arrays (n, len(names)).

        `stddev` of None is sent as empty (not known), `status` of None as OK.
        """
        status = np.zeros(np.shape(tension), np.uint8) if status is None else status
        arrays = {"tension": tension, "stddev": stddev, "status": status}
        self._write(CABLE_TENSIONS.name, topic, stamp_ns, names, arrays, log_ns, frame_id)

    def write_nodal_forces(
        self,
        topic: str,
        stamp_ns: ArrayLike,
        names: Sequence[str],
        magnitude: ArrayLike,
        *,
        force_x: ArrayLike | None = None,
        force_y: ArrayLike | None = None,
        force_z: ArrayLike | None = None,
        stddev: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        slip_speed: ArrayLike | None = None,
        status: ArrayLike | None = None,
        log_ns: ArrayLike | None = None,
        frame_id: str = "",
    ) -> None:
        """cdrj_msgs/NodalForces [N, m/s]; stamps (n,), arrays (n, len(names)).

        `status` of None is sent as OK, any other array of None as empty (not known).
        """
        status = np.zeros(np.shape(magnitude), np.uint8) if status is None else status
        arrays = {
            "force_x": force_x,
            "force_y": force_y,
            "force_z": force_z,
            "magnitude": magnitude,
            "stddev": stddev,
            "friction": friction,
            "slip_speed": slip_speed,
            "status": status,
        }
        self._write(NODAL_FORCES.name, topic, stamp_ns, names, arrays, log_ns, frame_id)

    def copy(self, path: Path | str, topic_names: Collection[str] | None = None) -> None:
        """Take over the messages of another bag unchanged, of these topics or (None) of all."""
        source = open_source(path)
        for file in source.files:
            for batch in file.batches():
                first = self._arrived
                self._arrived += len(batch.start)
                for number, channel in file.channels.items():
                    chosen = np.flatnonzero(batch.channel == number)
                    if topic_names is not None and channel.topic not in topic_names:
                        continue
                    require_cdr(source.path, channel)
                    own = self._channel(channel)
                    if not len(chosen):
                        continue
                    for octets, start, length, index in plain_payloads(batch, chosen):
                        self._keep(own, octets, start, length, batch.log_ns[index], first + index)

    def write_raw(
        self,
        topic: str,
        msgtype: str,
        log_ns: ArrayLike,
        payloads: Sequence[bytes],
        definition: str | None = None,
    ) -> None:
        """Messages already in CDR; `definition` of None means that the project knows the type."""
        times = np.array(log_ns, np.int64)
        if times.shape != (len(payloads),):
            raise BagError(f"{topic}: {len(payloads)} messages but log times {times.shape}")
        text = own_definition(long_name(msgtype)).text if definition is None else definition
        channel = self._channel(Channel(topic, long_name(msgtype), "cdr", "ros2msg", text))
        length = np.array([len(payload) for payload in payloads], np.int64)
        octets = np.frombuffer(b"".join(payloads), np.uint8)
        arrival = np.arange(self._arrived, self._arrived + len(times))
        self._arrived += len(times)
        self._keep(channel, octets, np.cumsum(length) - length, length, times, arrival)

    def close(self) -> None:
        """Write the folder.  Called by the context manager."""
        if self._closed:
            return
        self._closed = True
        name = f"{self.path.name}_0.mcap"
        try:
            self.path.mkdir(parents=True)
        except OSError as error:
            raise BagError(f"{self.path} cannot be made: {error.strerror or error}") from None
        try:
            text = self._information(name)
            with (self.path / name).open("xb") as stream:
                write_file(
                    stream,
                    list(self._schemas.values()),
                    list(self._channels.values()),
                    self._blocks,
                    compression=self._compression,
                    chunk_bytes=self._chunk_bytes,
                    serialized_metadata=text,
                )
            (self.path / METADATA).write_text(metadata_file(text), encoding="utf-8")
        except BaseException:
            shutil.rmtree(self.path, ignore_errors=True)
            raise

    def _write(
        self,
        msgtype: str,
        topic: str,
        stamp_ns: ArrayLike,
        names: Sequence[str],
        arrays: Mapping[str, ArrayLike | None],
        log_ns: ArrayLike | None,
        frame_id: str,
    ) -> None:
        definition = own_definition(msgtype).text
        channel = self._channel(Channel(topic, msgtype, "cdr", "ros2msg", definition))
        stamps = np.array(stamp_ns, np.int64)
        times = stamps if log_ns is None else np.array(log_ns, np.int64)
        given = {name: np.array(a) for name, a in arrays.items() if a is not None}
        shape = (*stamps.shape, len(names))
        wrong = {name: a.shape for name, a in given.items() if a.shape != shape}
        if stamps.ndim != 1 or times.shape != stamps.shape or wrong:
            raise BagError(
                f"{topic}: {stamps.shape} stamps, {times.shape} log times and {len(names)} names "
                f"take arrays of shape {shape}, got {wrong}"
            )
        arrival = np.arange(self._arrived, self._arrived + len(stamps))
        self._arrived += len(stamps)
        if (np.diff(times) < 0).any():
            order = np.argsort(times, kind="stable")
            times, stamps, arrival = times[order], stamps[order], arrival[order]
            given = {name: values[order] for name, values in given.items()}
        template = Template(
            parse_definition(msgtype, definition), names, list(given), frame_id=frame_id
        )
        self._blocks.append(_Encoded(channel, times, arrival, stamps, template, given))

    def _keep(
        self,
        channel: int,
        octets: Octets,
        start: Int64s,
        length: Int64s,
        log_ns: Int64s,
        arrival: Int64s,
    ) -> None:
        """Blocks of equal length of messages that lie in `octets`."""
        for size in np.unique(length).tolist():
            same = np.flatnonzero(length == size)
            same = same[np.argsort(log_ns[same], kind="stable")]
            data = np.zeros((len(same), MESSAGE_HEAD + size), np.uint8)
            if size:
                data[:, MESSAGE_HEAD:] = pick(octets, start[same], size)
            self._blocks.append(_Copied(channel, log_ns[same], arrival[same], data))

    def _channel(self, wanted: Channel) -> int:
        """Number of the topic's channel, made where it is new."""
        if self._closed:
            raise BagError(f"{self.path} is closed")
        known = self._declared.get(wanted.topic)
        if known is not None:
            self._require_same(known, wanted)
            number: int = self._channels[wanted.topic].id
            return number
        key = (wanted.msgtype, wanted.definition_encoding, wanted.definition)
        schema = self._schemas.get(key)
        if schema is None:
            schema = records.Schema(
                id=len(self._schemas) + 1,
                name=wanted.msgtype,
                encoding=wanted.definition_encoding,
                data=wanted.definition.encode(),
            )
            self._schemas[key] = schema
        channel = records.Channel(
            id=len(self._channels) + 1,
            topic=wanted.topic,
            message_encoding=wanted.encoding,
            metadata={"offered_qos_profiles": OFFERED_QOS, "topic_type_hash": _type_hash(wanted)},
            schema_id=schema.id,
        )
        self._channels[wanted.topic] = channel
        self._declared[wanted.topic] = wanted
        return len(self._channels)

    def _require_same(self, known: Channel, wanted: Channel) -> None:
        """A topic keeps its type; definitions may differ in their comments only."""
        if known.msgtype != wanted.msgtype:
            raise BagError(
                f"{self.path}: topic {known.topic} is {known.msgtype}, it cannot also be "
                f"{wanted.msgtype}"
            )
        if known.definition != wanted.definition and _fields(known) != _fields(wanted):
            raise BagError(
                f"{self.path}: topic {known.topic} is {known.msgtype} with other fields than before"
            )

    def _information(self, file_name: str) -> str:
        """What metadata.yaml tells, also kept inside the MCAP file."""
        counts = dict.fromkeys((channel.id for channel in self._channels.values()), 0)
        for block in self._blocks:
            counts[block.channel] += len(block.log_ns)
        times = [block.log_ns for block in self._blocks if len(block.log_ns)]
        topics = [
            WrittenTopic(
                channel.topic,
                self._declared[channel.topic].msgtype,
                channel.metadata["topic_type_hash"],
                counts[channel.id],
            )
            for channel in self._channels.values()
        ]
        start_ns = min((int(log_ns[0]) for log_ns in times), default=0)
        end_ns = max((int(log_ns[-1]) for log_ns in times), default=0)
        return information(file_name, start_ns, end_ns, topics)


def _fields(channel: Channel) -> object:
    """What a definition says apart from comments; its text where it cannot be taken apart."""
    try:
        return message_type(channel.msgtype, channel.definition_encoding, channel.definition)
    except BagError:
        return channel.definition


def _type_hash(channel: Channel) -> str:
    """The type's hash: as the copied bag has it, else as computed for this project's types."""
    copied = dict(channel.metadata).get("topic_type_hash")
    if copied is not None:
        return copied
    try:
        own = own_definition(channel.msgtype)
    except BagError:
        return ""
    return own.hash if own.text == channel.definition else ""
