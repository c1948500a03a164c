"""Complaints about a robot file, by the path of the key."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from cdrj_ros.foundation.errors import RobotFileError

LONGEST_TEXT: Final = 400
"""Characters of a complaint that quotes the file."""


@dataclass(frozen=True)
class Refusal:
    """Makes the errors of one robot file."""

    source: str
    """The file's name."""

    def __call__(self, path: str, text: str) -> RobotFileError:
        """The error of a key: its path, what was given and what is allowed."""
        text = text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}..."
        return RobotFileError(f"{path} {text} ({self.source})")


def listed(names: Iterable[str]) -> str:
    """Names in a message."""
    return ", ".join(sorted(names)) or "(none)"
