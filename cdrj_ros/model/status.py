"""Status of an element: bit flags; the same values stand in cdrj_msgs/CableTensions."""

from __future__ import annotations

OK, SLACK, OVERLOAD, UNSURE, STALE, INVALID = 0, 1, 2, 4, 8, 16
