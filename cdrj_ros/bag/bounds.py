"""Bounds on everything that a bag may claim, each with its reason.

A bag may come from anywhere.  A few kilobytes can claim, or unpack to, more memory than a machine
has.  No ordinary recording comes near these bounds; `docs/reliability.md` lists them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cdrj_ros.foundation.errors import BagError

MESSAGE_BYTES: Final = 1 << 26
"""Of one message, unpacked.  A joint state of 1000 joints has 40 kB; a large image has 30 MB."""
CHUNK_BYTES: Final = 1 << 26
"""Of one chunk of an MCAP file, unpacked, and of what is unpacked ahead of its use.  Writers make
chunks of 1 to 4 MB."""
UNPACKED_FREE: Final = 1 << 28
"""Bytes that any file may unpack to in one pass: chunks, single messages or the whole file."""
UNPACKED_RATIO: Final = 1000
"""Beyond `UNPACKED_FREE`, how many bytes may stand for each byte on the disk.  Joint states of a
robot at rest reach some 100; a file made to fill the memory reaches 30 000."""
UNPACKED_FILE: Final = 1 << 32
"""Of a file that is compressed as a whole (`.mcap.zstd`), which is unpacked to a temporary file."""

DEFINITION_BYTES: Final = 1 << 20
"""Of a record that declares a message type or a channel.  Those of ROS have a few kilobytes."""
DEFINITION_FIELDS: Final = 10_000
"""Of a message type, nested messages written out.  Each level of nesting may multiply them."""
DEFINITION_DEPTH: Final = 8
"""Levels of nested messages."""
ARRAY_VALUES: Final = MESSAGE_BYTES
"""Of an array whose size the definition fixes: no message can hold more."""

METADATA_BYTES: Final = 1_000_000
"""Of metadata.yaml; a larger one is not read, and the folder's files are taken instead."""

DATABASE_STEPS_FREE: Final = 100_000_000
"""Instructions of SQLite's virtual machine that every pass over a database may take."""
DATABASE_STEPS: Final = 100
"""Beyond that, instructions for each byte of the database.  Reading a message takes some 20."""

LARGEST_REFERENCE: Final = 1e15
"""Of a recorded reference [N or N·m].  A larger one is no measurement; its square may overflow."""


class Unpacked:
    """Counts what one pass over a file has unpacked."""

    def __init__(self, path: Path, packed: int) -> None:
        """`packed` is the size of the file on the disk [bytes]."""
        self._path = path
        self._left = self.limit = max(UNPACKED_FREE, UNPACKED_RATIO * packed)

    def add(self, size: int) -> None:
        """Count `size` bytes more.

        Raises:
            BagError: they are too many for the file's size.
        """
        self._left -= size
        if self._left < 0:
            raise BagError(
                f"{self._path} unpacks to more than {self.limit} bytes, "
                f"more than {UNPACKED_RATIO} times its size: refused as damaged or malicious"
            )
