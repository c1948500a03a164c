"""Whether a stamp continues its channel, or the clock may have jumped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Literal

from cdrj_ros.conditioning.gate import MAX_GAP_NS, Channel

STRAGGLERS: Final = 100
"""Greatest number of readings from before a clock jump that a channel may deliver after it."""

Timing = Literal["", "repeated", "late", "another time"]
"""Result for a stamp: usable, a cause of refusal, or held until later readings confirm it."""


def timing_of(channel: Channel, stamp: int, channels: Sequence[Channel]) -> Timing:
    """Compare a stamp with the last one accepted on its channel, one of ``channels``."""
    last = channel.last_stamp
    if last < 0:
        straggles = channel.left_behind >= 0 and _is_straggler(channel, stamp, channels)
        return "late" if straggles else ""
    ahead = stamp - last
    if 0 < ahead <= MAX_GAP_NS or 0 < ahead <= channel.patience_ns:
        return ""
    if ahead == 0:
        return "repeated"
    if ahead > 0 or ahead < -MAX_GAP_NS or channel.held:
        return "another time"
    return "late"


def _is_straggler(channel: Channel, stamp: int, channels: Sequence[Channel]) -> bool:
    """Whether the first reading after the clock went back has a stamp from before the jump.

    The last messages of one topic may arrive after the first messages of another topic that carry
    the new time.
    """
    if abs(stamp - channel.left_behind) > MAX_GAP_NS or channel.stragglers >= STRAGGLERS:
        return False
    newest = max(other.last_stamp for other in channels)
    if stamp - newest <= MAX_GAP_NS:
        return False
    channel.stragglers += 1
    return True
