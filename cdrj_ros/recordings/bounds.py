"""Bounds on the sizes that a bag may claim, each with its reason.

A bag may come from an untrusted source, and a few kilobytes can claim, or unpack to, more memory
than a machine has.  Ordinary recordings stay far below these bounds; `docs/reliability.md` lists
them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cdrj_ros.foundation.errors import BagError

MESSAGE_BYTES: Final = 1 << 26
"""Size of one unpacked message.  A joint state of 1000 joints has 40 kB, a large image 30 MB."""
CHUNK_BYTES: Final = 1 << 26
"""Size of one unpacked chunk of an MCAP file, and total size of the chunks unpacked ahead.  Writers
make chunks of 1 to 4 MB."""
UNPACKED_FREE: Final = 1 << 28
"""Bytes to which any file may unpack in one pass: chunks, single messages or the whole file."""
UNPACKED_RATIO: Final = 1000
"""Compression ratio allowed beyond `UNPACKED_FREE`.  Joint states of a robot at rest reach about
100; a file made to fill the memory reaches 30 000."""
UNPACKED_FILE: Final = 1 << 32
"""Unpacked size of a file compressed as a whole (`.mcap.zstd`); it goes to a temporary file."""

DEFINITION_BYTES: Final = 1 << 20
"""Size of a record that declares a message type or a channel.  Those of ROS have some kilobytes."""
DEFINITION_FIELDS: Final = 10_000
"""Lines of a message definition, with nested messages expanded.  Each level may multiply them."""
DEFINITION_DEPTH: Final = 8
"""Levels of nested messages."""
ARRAY_VALUES: Final = MESSAGE_BYTES
"""Length of an array of fixed size: no message can hold more."""

METADATA_BYTES: Final = 1_000_000
"""Size of metadata.yaml; a larger one is not read, and the files in the folder are used instead."""

LARGEST_REFERENCE: Final = 1e15
"""Magnitude of a recorded reference [N or N·m].  Larger values are implausible; their square may
overflow."""


class Unpacked:
    """Counts the bytes that one pass over a file has unpacked."""

    def __init__(self, path: Path, packed: int) -> None:
        """`packed` is the size of the file on the disk [bytes]."""
        self._path = path
        self._left = self.limit = max(UNPACKED_FREE, UNPACKED_RATIO * packed)

    def add(self, size: int) -> None:
        """Add `size` bytes to the count.

        Raises:
            BagError: the total is too large for the file's size.
        """
        self._left -= size
        if self._left < 0:
            raise BagError(
                f"{self._path} unpacks to more than {self.limit} bytes, "
                f"more than {UNPACKED_RATIO} times its size: refused as damaged or malicious"
            )
