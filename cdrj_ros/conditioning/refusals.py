"""Causes for which readings are refused, and those that apply to every channel alike."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

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

END_OF_TIME_NS: Final = 2**31 * 1_000_000_000
"""Every stamp of a message header is below this [ns]."""


def unusable(stamp: int, reading: float) -> Literal["", "not_finite", "late", "future"]:
    """Cause for refusing a reading on any channel; empty if there is none."""
    if reading - reading != 0.0:  # NaN and both infinities
        return "not_finite"
    if not 0 < stamp < END_OF_TIME_NS:
        return "late" if stamp <= 0 else "future"
    return ""
