"""One way to write a file: whole or not at all, and never over what is being read."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from cdrj_ros.foundation.errors import UsageError

StrPath = str | os.PathLike[str]


@contextmanager
def replacing(path: StrPath) -> Iterator[BinaryIO]:
    """Yield a binary stream; what is written to it becomes ``path`` when the block ends.

    The content goes to a temporary file in the same folder, is synchronised to the disk and then
    renamed.  A reader sees the old file or the new one; if the block raises or the disk is full,
    ``path`` stays as it was.  A symbolic link is followed; the permissions of a replaced file are
    kept.  What is no file, such as /dev/null or a named pipe, is written to as it is.

    Raises:
        OSError: the folder is missing, full or not writable.
    """
    target = Path(os.path.realpath(path))
    if _is_device(target):
        with target.open("wb") as stream:
            yield stream
        return
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:100]}.")
    draft = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        draft.chmod(_permissions(target))
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def _is_device(target: Path) -> bool:
    """Whether the path is something else than a file or a folder."""
    return target.exists() and not target.is_file() and not target.is_dir()


def _permissions(target: Path) -> int:
    """Those of the file that is replaced, else what the process gives to a new file."""
    try:
        return target.stat().st_mode & 0o777
    except OSError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask


def write_bytes(path: StrPath, content: bytes) -> None:
    """Write a file atomically, see ``replacing``."""
    with replacing(path) as stream:
        stream.write(content)


def write_text(path: StrPath, text: str) -> None:
    """Write a UTF-8 file atomically, see ``replacing``; unpaired surrogates are escaped."""
    write_bytes(path, text.encode("utf-8", "backslashreplace"))


def check_outputs(outputs: Mapping[str, StrPath | None], inputs: Iterable[StrPath] = ()) -> None:
    """Check before long work that every output can be written and replaces no input.

    Args:
        outputs: files by the option that names them; None where the option is not used.
        inputs: files and folders that are read.  An output may neither be one of them nor lie in
            an input folder.

    Raises:
        UsageError: an output names an input, another output, a folder, or a file in a folder that
            is missing or not writable.
    """
    sources = [Path(os.path.realpath(path)) for path in inputs]
    taken: dict[Path, str] = {}
    for option, path in outputs.items():
        if path is None:
            continue
        target = Path(os.path.realpath(path))
        for source in sources:
            if target == source or (source.is_dir() and source in target.parents):
                raise UsageError(f"{option} {path} would overwrite the input {source.name}")
        if target in taken:
            raise UsageError(f"{option} and {taken[target]} both name {path}")
        taken[target] = option
        if _is_device(target):
            continue
        if target.is_dir():
            raise UsageError(f"{option} {path} is a folder")
        if not target.parent.is_dir():
            raise UsageError(f"{option} {path}: there is no folder {Path(path).parent}")
        if not os.access(target.parent, os.W_OK):
            raise UsageError(f"{option} {path}: the folder {Path(path).parent} is not writable")


def check_new(outputs: Mapping[str, StrPath | None], *, force: bool) -> None:
    """Check before long work that no output replaces an existing file, unless that is asked for.

    This is for results that cost work: robot files and figures.  Reports are replaced, since the
    same command makes them again.

    Args:
        outputs: files by the option that names them; None where the option is not used.
        force: whether existing files may be replaced.

    Raises:
        UsageError: a file exists and ``force`` is not set.
    """
    for option, path in outputs.items():
        if path is not None and not force and Path(path).exists():
            raise UsageError(f"{option} {path} exists already; --force replaces it")
