"""Results of another process on this machine: their arrays stay in memory that both share.

Through the pipe alone, the arrays of a bag take as long as a twentieth of the work on it, and
occupy both processes.
"""

from __future__ import annotations

import os
import pickle
from mmap import mmap
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from typing import Any, Final, NamedTuple

ALIGNMENT: Final = 64
"""Of every array in the shared memory [B]."""


class Envelope(NamedTuple):
    """An object without the contents of its arrays."""

    pickled: bytes
    places: list[tuple[int, int]]
    """Begin and end of the contents of every array in the shared memory [B]."""


def send_large(connection: Connection, kind: str, value: Any) -> None:
    """Send an object with large arrays to the parent process, which calls ``receive_large``.

    Args:
        connection: to the parent process, made by ``Pipe``.
        kind: tells what it is; received first, with the envelope.
        value: the object.
    """
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    contents = [buffer.raw() for buffer in buffers]
    places, end = [], 0
    for content in contents:
        places.append((end, end + content.nbytes))
        end += -(-content.nbytes // ALIGNMENT) * ALIGNMENT
    with os.fdopen(os.memfd_create("cdrj_ros"), "wb") as shared:
        for content, (begin, _) in zip(contents, places, strict=True):
            shared.seek(begin)
            shared.write(content)
        shared.flush()
        connection.send((kind, Envelope(pickled, places)))
        send_handle(connection, shared.fileno(), 0)  # Unix does not need the receiver's id


def receive_large(connection: Connection, envelope: Envelope) -> Any:
    """The object of an envelope; its arrays are views of the shared memory and can be written to.

    Raises:
        EOFError: the other process died before it had sent all.
    """
    places = envelope.places
    size = max((end for _, end in places), default=0)
    file = recv_handle(connection)
    try:
        shared = memoryview(mmap(file, size) if size else b"")
    finally:
        os.close(file)
    contents = [shared[begin:end] for begin, end in places]
    return pickle.loads(envelope.pickled, buffers=contents)  # noqa: S301  of our own process
