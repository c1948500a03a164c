"""Bit flags of an element's status; cdrj_msgs/CableTensions defines the same values."""

from __future__ import annotations

OK, SLACK, OVERLOAD, UNSURE, STALE, INVALID = 0, 1, 2, 4, 8, 16
