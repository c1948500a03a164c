"""Exceptions of this package.  Library code raises them; only commands exit."""

from __future__ import annotations

from cdrj_ros.foundation.text import printable


class CdrjError(Exception):
    """Base class of all errors raised deliberately by this package; the text is one line.

    Control characters in the text, which may come from a file, are escaped.
    """

    def __init__(self, text: object = "") -> None:
        super().__init__(printable(text))


class RobotFileError(CdrjError):
    """A robot file that describes no valid robot, or another invalid file in YAML."""

    def __init__(self, text: str) -> None:
        line = printable(" ".join(text.split()))  # a key may hold line breaks and escapes
        super().__init__(line if len(line) <= 600 else f"{line[:400]} ... {line[-180:]}")


class BagError(CdrjError):
    """A recording that cannot be read, or lacks the requested data."""

    def __init__(self, text: str) -> None:
        super().__init__(printable(text))  # names and paths may hold any characters


class UsageError(CdrjError):
    """A command line or call with invalid arguments."""
