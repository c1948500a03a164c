"""Causes for which readings are refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

REFUSALS: Final[Mapping[str, str]] = {
    "malformed": "message refused whole: not as many positions as names, or not decodable",
    "empty": "message without a name",
    "unstamped": "message with a stamp that is not after zero",
    "unknown_name": "name that the robot file does not have",
    "not_finite": "NaN or infinite position",
    "repeated": "stamp equal to the last one accepted",
    "late": "stamp before the last one accepted, or before the clock's zero",
    "future": "stamp too far ahead and not confirmed by later readings, or never valid",
    "out_of_range": "joint angle outside its range",
    "implausible": "further from the last reading than max_speed allows, or than any angle",
}
"""Causes for which a reading is refused, and their meaning."""

WHOLE: Final = ("malformed", "empty", "unstamped")
"""Causes for which a message is refused whole and counted once, however many names it has."""
