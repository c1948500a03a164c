"""Random access to the bytes of one file."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import IO, Final

from cdrj_ros.foundation.errors import BagError

_WINDOW: Final = 1 << 20


def open_regular(path: Path) -> IO[bytes]:
    """Open a regular file for reading; a pipe or a device might never end.

    Raises:
        BagError: it cannot be read or is not a regular file.
    """
    try:
        stream = open(path, "rb", opener=_without_waiting)  # noqa: SIM115
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise BagError(f"{path} cannot be read: {reason or error}") from None
    if stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
        return stream
    stream.close()
    raise BagError(f"{path} is not a regular file")


def _without_waiting(path: str, flags: int) -> int:
    """Open without blocking: opening a named pipe would otherwise wait for a writer."""
    return os.open(path, flags | os.O_NONBLOCK)


class FileBytes:
    """A file read by offset, from any thread.

    The file is not memory-mapped: truncating a mapped file while it is read would kill the process
    (SIGBUS).  Here, reading it returns fewer bytes.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        """Keep a regular file open, independently of `stream`."""
        self._descriptor = os.dup(stream.fileno())
        self._window = b""
        self._at = 0
        self.size = os.fstat(self._descriptor).st_size

    def __del__(self) -> None:
        """Close the file; there is no other point at which the last batch is known to be read."""
        os.close(self._descriptor)

    def read(self, start: int, stop: int) -> bytes:
        """The bytes [start, stop), or fewer if the file has been truncated."""
        parts: list[bytes] = []
        while start < stop and (part := os.pread(self._descriptor, stop - start, start)):
            parts.append(part)
            start += len(part)
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def peek(self, start: int, count: int) -> bytes:
        """Read a few bytes through a window, for a single thread that reads in order."""
        at = start - self._at
        if at < 0 or at + count > len(self._window):
            self._window, self._at, at = self.read(start, start + _WINDOW), start, 0
        return self._window[at : at + count]
