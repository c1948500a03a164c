"""Files: reading in bounded time and memory, atomic writing, and checks of outputs."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any, BinaryIO, Final, NoReturn
from xml.etree import ElementTree as Xml

from cdrj_ros.foundation.errors import CdrjError, UsageError

StrPath = str | os.PathLike[str]


@contextmanager
def replacing(path: StrPath) -> Iterator[BinaryIO]:
    """Yield a binary stream whose content replaces ``path`` when the block ends.

    The content goes to a temporary file in the same folder, which is synchronised to the disk and
    then renamed.  A reader sees the old file or the new one; if the block raises or the disk is
    full, ``path`` is unchanged.  A symbolic link is followed; the permissions of a replaced file
    are kept.  Special files such as /dev/null or a named pipe are written directly.

    Raises:
        OSError: the folder is missing, full or not writable; it names the path.
    """
    target = Path(os.path.realpath(path))
    try:
        yield from _replacing(target)
    except OSError as error:
        if error.errno is not None and error.filename is None:  # a failed write names no file
            error.filename = os.fspath(path)
        raise


def _replacing(target: Path) -> Iterator[BinaryIO]:
    """``replacing`` for a path without symbolic links."""
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
    """Whether the path exists and is neither a regular file nor a folder."""
    return target.exists() and not target.is_file() and not target.is_dir()


def _permissions(target: Path) -> int:
    """Permissions of the replaced file, or the process's default for a new file."""
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


def check_outputs(
    outputs: Mapping[str, StrPath | None], inputs: Iterable[StrPath] = (), *, force: bool = True
) -> None:
    """Check before a long computation that every output can be written and replaces no input.

    Args:
        outputs: files by the option that names them; None if the option is not used.
        inputs: files and folders to be read.  An output must neither be one of them nor lie in an
            input folder.
        force: whether existing files may be replaced: robot files and figures are expensive to
            reproduce, but the same command produces a report again.

    Raises:
        UsageError: an output names an input, another output, a folder, or a file in a folder that
            is missing or not writable, or one that exists without ``force``.
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
        if obstacle := _obstacle(Path(path), target, force=force):
            raise UsageError(f"{option} {path}{obstacle}")


def _obstacle(path: Path, target: Path, *, force: bool) -> str:
    """Why a file cannot be written, or must not be; empty if it may."""
    if _is_device(target):
        return ""
    if target.is_dir():
        return " is a folder"
    if not target.parent.is_dir():
        return f": there is no folder {path.parent}"
    if not os.access(target.parent, os.W_OK):
        return f": the folder {path.parent} is not writable"
    return " exists already; --force replaces it" if target.exists() and not force else ""


def size_of(path: StrPath) -> int:
    """Size of a file, or of the files in a folder [B]; at least 1, also if there is none."""
    path = Path(path)
    try:
        files = list(path.iterdir()) if path.is_dir() else [path]
        return max(sum(file.stat().st_size for file in files if file.is_file()), 1)
    except (OSError, ValueError):
        return 1


CHUNK: Final = 1 << 16
"""Bytes of XML that are parsed before a document type refused in them ends the parsing."""


class InputError(CdrjError):
    """An input that cannot be read; the text goes on from the input's name and a colon."""


def open_regular(path: StrPath) -> FileIO:
    """Open a regular file for reading; a pipe, on which that might not end, is refused.

    Raises:
        InputError: there is no such file, or it is not a regular one.
    """
    try:
        # otherwise a named pipe would wait for a writer
        raw = FileIO(path, opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK))
    except (OSError, ValueError) as error:  # a value: a null character in the path
        reason = error.strerror if isinstance(error, OSError) else None
        raise InputError(reason or str(error)) from error
    if stat.S_ISREG(os.fstat(raw.fileno()).st_mode):
        return raw
    raw.close()
    raise InputError("it is not a regular file")


def read_regular(path: StrPath, most_bytes: int) -> bytes:
    """Content of a regular file.

    Raises:
        InputError: as ``open_regular``, or it is too large.
    """
    with open_regular(path) as stream:
        try:
            data = stream.read(most_bytes + 1)
        except OSError as error:
            raise InputError(error.strerror or str(error)) from error
        size = max(os.fstat(stream.fileno()).st_size, len(data))
    if len(data) > most_bytes:
        raise InputError(f"it has {size} bytes, at most {most_bytes} are read")
    return data


class _Builder(Xml.TreeBuilder):
    """Without a document type there are no entities, and so no expansion of them."""

    def doctype(self, *_declared: Any) -> NoReturn:
        raise InputError("it declares a document type, which is not needed")


def parse_xml(data: bytes) -> Xml.Element:
    """The root of an XML document without a document type, in any encoding.

    Raises:
        InputError: it is no XML, or declares a document type.
    """
    parser = Xml.XMLParser(target=_Builder())
    try:
        for begin in range(0, len(data), CHUNK):
            parser.feed(data[begin : begin + CHUNK])
        root: Xml.Element = parser.close()
    except (Xml.ParseError, ValueError, LookupError) as error:  # also an unknown encoding
        raise InputError(f"it is no XML: {error}") from error
    return root
