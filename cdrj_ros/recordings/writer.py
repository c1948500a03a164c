"""Write a rosbag2 folder that holds metadata.yaml and one MCAP file."""

from __future__ import annotations

import os
import shutil
import struct
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from heapq import merge
from operator import itemgetter
from pathlib import Path
from textwrap import indent
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, Final, TypeVar
from uuid import uuid4

import numpy as np
import numpy.typing as npt

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.files import write_text
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES, MessageType
from cdrj_ros.messages.templates import Template
from cdrj_ros.recordings.batch import Channel, Int64s, require_cdr
from cdrj_ros.recordings.definitions import (
    bag_metadata,
    channel_metadata,
    message_type,
    own_definition,
)
from cdrj_ros.recordings.source import open_source, read_messages

if TYPE_CHECKING:
    from mcap.writer import Writer

_AT_ONCE: Final = 4096
"""Number of messages encoded at once."""

ArrayLike = npt.ArrayLike
Piece = TypeVar("Piece")
Queued = tuple[int, str, bytes]
"""Log time [ns], topic and payload of a message to be written."""


def require_new(path: Path) -> None:
    """Raise BagError if something is where a bag shall be written."""
    if path.exists():
        raise BagError(f"{path} exists already; a bag is written to a new folder")


class BagWriter:
    """Collects messages and writes them, in order of log time, when closed.

    The writer is a context manager; if its body raises, nothing is written.  The folder is created
    atomically.  Every `write_…` may be called repeatedly for a topic.  `log_ns` are the log times;
    None: the stamps.  Messages with equal log times keep the order of the calls.
    """

    def __init__(self, path: Path | str) -> None:
        """`path` is the folder to create."""
        self.path = Path(path)
        require_new(self.path)
        if not str(self.path).isprintable():
            raise BagError(
                f"{self.path} is not a name for a bag: metadata.yaml takes printable text"
            )
        self._channels: dict[str, Channel] = {}
        self._queue: list[Iterator[Queued]] = []
        """Sources of messages, each in order of time, that are asked when the file is written."""
        self._closed = False

    def __enter__(self) -> BagWriter:
        """Return the writer; nothing is written yet."""
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
        """Add sensor_msgs/JointState; stamps (n,), arrays (n, len(names)) or None for empty."""
        arrays = {"position": position, "velocity": velocity, "effort": effort}
        self.write(JOINT_STATE, topic, stamp_ns, names, arrays, log_ns, frame_id)

    def write_tensions(
        self,
        topic: str,
        stamp_ns: ArrayLike,
        names: Sequence[str],
        tension: ArrayLike,
        stddev: ArrayLike | None = None,
        *,
        log_ns: ArrayLike | None = None,
    ) -> None:
        """Add cdrj_msgs/CableTensions [N] that are OK; stamps (n,), arrays (n, len(names)).

        `stddev` of None is written as empty (unknown).
        """
        status = np.zeros(np.shape(tension), np.uint8)
        arrays = {"tension": tension, "stddev": stddev, "status": status}
        self.write(CABLE_TENSIONS, topic, stamp_ns, names, arrays, log_ns, "")

    def write_nodal_forces(
        self,
        topic: str,
        stamp_ns: ArrayLike,
        names: Sequence[str],
        magnitude: ArrayLike,
        *,
        log_ns: ArrayLike | None = None,
        frame_id: str = "",
        **others: ArrayLike | None,
    ) -> None:
        """Add cdrj_msgs/NodalForces [N, m/s]; stamps (n,), arrays (n, len(names)).

        `others` are arrays of the message by name. A `status` of None is written as OK, any other
        array of None as empty (unknown).
        """
        arrays = {
            "status": np.zeros(np.shape(magnitude), np.uint8),
            **others,
            "magnitude": magnitude,
        }
        self.write(NODAL_FORCES, topic, stamp_ns, names, arrays, log_ns, frame_id)

    def write(
        self,
        message: MessageType,
        topic: str,
        stamp_ns: ArrayLike,
        names: Sequence[str],
        arrays: Mapping[str, ArrayLike | None],
        log_ns: ArrayLike | None,
        frame_id: str,
    ) -> None:
        """Add messages of one of our types; stamps (n,), arrays (n, len(names)) by name.

        An array of None is written as empty (unknown).
        """
        self._declare_own(topic, message.name)
        stamps = np.array(stamp_ns, np.int64)
        times = stamps if log_ns is None else np.array(log_ns, np.int64)
        given = {name: np.array(a) for name, a in arrays.items() if a is not None}
        if unknown := set(given) - {field.name for field in message.fields}:
            raise BagError(f"{topic}: {message.name} has no {', '.join(sorted(unknown))}")
        shape = (*stamps.shape, len(names))
        wrong = {name: a.shape for name, a in given.items() if a.shape != shape}
        if stamps.ndim != 1 or times.shape != stamps.shape or wrong:
            raise BagError(
                f"{topic}: {stamps.shape} stamps, {times.shape} log times and {len(names)} names "
                f"take arrays of shape {shape}, got {wrong}"
            )
        if (times[1:] < times[:-1]).any():
            order = np.argsort(times, kind="stable")
            times, stamps = times[order], stamps[order]
            given = {name: values[order] for name, values in given.items()}
        template = Template(message, names, list(given), frame_id=frame_id)
        self._queue.append(_encoded(topic, times, stamps, template, given))

    def copy(self, path: Path | str, topic_names: Collection[str] | None = None) -> None:
        """Copy the messages of these topics (None: all) from another bag, unchanged.

        They are read when this writer is closed.
        """
        source = open_source(path)
        chosen = {
            topic: channel
            for topic, channel in source.all_channels().items()
            if topic_names is None or topic in topic_names
        }
        for channel in chosen.values():
            require_cdr(source.path, channel)
            self._declare(channel)
        if chosen:
            messages = read_messages(source, tuple(chosen))
            self._queue.append((one.log_ns, one.topic, one.data) for one in messages)

    def write_messages(
        self, topic: str, msgtype: str, messages: Sequence[tuple[int, bytes]]
    ) -> None:
        """Write messages as they were received.

        Args:
            topic: their topic.
            msgtype: one of the types that this package writes.
            messages: log times [ns], never decreasing, and payloads in CDR.
        """
        self._declare_own(topic, msgtype)
        self._queue.append((log_ns, topic, data) for log_ns, data in messages)

    def write_pieces(
        self,
        topics: Mapping[str, str],
        pieces: Iterable[Piece],
        write: Callable[[BagWriter, Piece], None],
    ) -> None:
        """Write what need not be in memory at once.

        Each piece is asked for, and forgotten, while the bag is written.  What `pieces` raises
        passes through, and no bag is left behind.

        Args:
            topics: types of the topics that `write` writes, by name.
            pieces: what is written, in order of log time.
            write: calls the `write_…` for one of them.
        """
        for topic, msgtype in topics.items():
            self._declare_own(topic, msgtype)

        def parts() -> Iterator[Queued]:
            for piece in pieces:
                part = BagWriter(self.path)
                write(part, piece)
                yield from merge(*part._queue, key=itemgetter(0))

        self._queue.append(parts())

    def close(self) -> None:
        """Write the folder; called by the context manager."""
        if self._closed:
            return
        self._closed = True
        draft = self.path.with_name(f".{self.path.name[:100]}.{uuid4().hex}")
        try:
            draft.mkdir(parents=True)
            name = f"{self.path.name}_0.mcap"
            with (draft / name).open("xb") as stream:
                text = self._write_file(stream, name)
                stream.flush()
                os.fsync(stream.fileno())
            write_text(
                draft / "metadata.yaml", "rosbag2_bagfile_information:\n" + indent(text, "  ")
            )
            draft.rename(self.path)
        except OSError as error:
            raise BagError(f"{self.path} cannot be made: {error.strerror or error}") from None
        finally:
            shutil.rmtree(draft, ignore_errors=True)

    def _write_file(self, stream: IO[bytes], name: str) -> str:
        """Write the MCAP file; return the metadata text, which is also stored inside the file."""
        from mcap.writer import Writer  # slow

        writer = Writer(stream)
        writer.start(profile="ros2", library="cdrj_ros")
        numbers = self._register(writer)
        counts = dict.fromkeys(self._channels, 0)
        first_ns: int | None = None
        last_ns = 0
        try:
            for log_ns, topic, data in merge(*self._queue, key=itemgetter(0)):
                first_ns, last_ns = log_ns if first_ns is None else first_ns, log_ns
                counts[topic] += 1
                writer.add_message(numbers[topic], log_ns, data, log_ns)
        except struct.error:
            raise BagError(f"{self.path}: a log time before {last_ns} ns is negative") from None
        text = bag_metadata(name, first_ns or 0, last_ns, self._channels.values(), counts)
        writer.add_metadata("rosbag2", {"serialized_metadata": text})
        writer.finish()  # type: ignore[no-untyped-call]
        return text

    def _register(self, writer: Writer) -> dict[str, int]:
        """Channel numbers by topic; equal definitions share a schema."""
        schemas: dict[tuple[str, str, str], int] = {}
        numbers: dict[str, int] = {}
        for topic, channel in self._channels.items():
            key = (channel.msgtype, channel.definition_encoding, channel.definition)
            if key not in schemas:
                name, encoding, text = key
                schemas[key] = writer.register_schema(name, encoding, text.encode())
            metadata = channel_metadata(channel)
            numbers[topic] = writer.register_channel(topic, "cdr", schemas[key], metadata)
        return numbers

    def _declare_own(self, topic: str, msgtype: str) -> None:
        """Declare a topic of one of our types."""
        self._declare(Channel(topic, msgtype, "cdr", "ros2msg", own_definition(msgtype).text))

    def _declare(self, wanted: Channel) -> None:
        """Declare a topic; a known topic must keep its type and fields (comments may differ)."""
        if self._closed:
            raise BagError(f"{self.path} is closed")
        known = self._channels.setdefault(wanted.topic, wanted)
        if known.msgtype != wanted.msgtype:
            raise BagError(
                f"{self.path}: topic {known.topic} is {known.msgtype}, it cannot also be "
                f"{wanted.msgtype}"
            )
        if known.definition != wanted.definition and _fields(known) != _fields(wanted):
            raise BagError(
                f"{self.path}: topic {known.topic} is {known.msgtype} with other fields than before"
            )


def _encoded(
    topic: str, log_ns: Int64s, stamp_ns: Int64s, template: Template,
    arrays: Mapping[str, npt.NDArray[Any]],
) -> Iterator[Queued]:  # fmt: skip
    """Messages of one topic, some of which are encoded at a time; log times never decrease."""
    size = len(template.payload)
    for first in range(0, len(log_ns), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        given = {name: values[part] for name, values in arrays.items()}
        data = template.encode_many(stamp_ns[part], given).tobytes()
        for k, at in enumerate(log_ns[part].tolist()):
            yield at, topic, data[k * size : (k + 1) * size]


def _fields(channel: Channel) -> object:
    """The parsed fields of a definition; its text if it cannot be parsed."""
    try:
        return message_type(channel.msgtype, channel.definition_encoding, channel.definition)
    except BagError:
        return channel.definition
