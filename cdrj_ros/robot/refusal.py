"""Errors of a robot file, each with the path of the key."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from cdrj_ros.foundation.errors import RobotFileError

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


def listed(names: Iterable[str]) -> str:
    """Format names for a message."""
    return ", ".join(sorted(names)) or "(none)"
