"""Read untrusted files and XML in bounded time and memory."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any, Final, NoReturn
from xml.etree import ElementTree as Xml

from cdrj_ros.foundation.errors import CdrjError

CHUNK: Final = 1 << 16
"""Bytes of XML that are parsed before a document type refused in them ends the parsing."""


class InputError(CdrjError):
    """An input that cannot be read; the text goes on from the input's name and a colon."""


def read_regular(path: str | Path, most_bytes: int) -> bytes:
    """Content of a regular file; a pipe, on which reading might not end, is not opened to the end.

    Raises:
        InputError: there is no such file, it is not a regular one, or it is too large.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(handle, "rb") as stream:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise InputError("it is not a regular file")
            data = stream.read(most_bytes + 1)
            size = max(os.fstat(handle).st_size, len(data))
    except OSError as error:
        raise InputError(error.strerror or str(error)) from error
    except ValueError as error:  # a null character in the path
        raise InputError(str(error)) from error
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
