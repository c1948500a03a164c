"""Exceptions of this package, raised by library code; only commands exit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final

from cdrj_ros.foundation.output import printable


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


class UsageError(CdrjError):
    """A command line or call with invalid arguments."""


def reason_of(error: CdrjError | OSError) -> str:
    """What went wrong, in one line that names the file if there is one."""
    if isinstance(error, CdrjError):
        return str(error)
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror or error}"


LONGEST_TEXT: Final = 400
"""Largest length of an error text, which may quote the file."""


@dataclass(frozen=True)
class Refusal:
    """Creates the errors of one robot file."""

    source: str
    """The file's name."""

    def __call__(self, path: str, text: str) -> RobotFileError:
        """Create the error of a key; ``text`` says what was given and what is allowed."""
        text = text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}..."
        return RobotFileError(f"{path} {text} ({self.source})")


def nearest(unknown: str, known: Sequence[str]) -> str:
    """A hint at the known name that is most like an unknown one, or at all of them."""
    close = get_close_matches(unknown, known, n=1)
    return f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}"


def ordered(names: Iterable[str]) -> str:
    """Format names for a message."""
    return ", ".join(sorted(names)) or "(none)"
