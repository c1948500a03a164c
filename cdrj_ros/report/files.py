"""Writing a result so that nobody ever reads half of it."""

from __future__ import annotations

import os
from pathlib import Path


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a UTF-8 file whole or not at all: a neighbour is written, then takes its name.

    Args:
        path: the file, replaced if it exists; its folder must exist.
        text: the content.

    Raises:
        OSError: the folder is missing, full or not writable; ``path`` is then as before.
    """
    target = Path(path)
    draft = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with draft.open("w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)
