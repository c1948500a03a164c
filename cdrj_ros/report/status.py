"""Words and colours of a status, and how tensions are shown on a screen."""

from __future__ import annotations

from math import floor, log10
from typing import Final

from cdrj_ros.model.packing import INVALID, OK, OVERLOAD, SLACK, STALE, UNSURE

STATUS: Final = (
    (INVALID, "INVALID", "bold red"),
    (OVERLOAD, "OVERLOAD", "bold red"),
    (STALE, "STALE", "magenta"),
    (SLACK, "SLACK", "cyan"),
    (UNSURE, "UNSURE", "yellow"),
)
"""Flag, word and style of every status, most severe first."""

FINE: Final = ("OK", "green")
"""Word and style of an entry without any flag."""

SIGMAS: Final = 2.0
"""Half width of the displayed interval [standard deviations]."""

SCALES: Final = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0)
"""Full scales of a bar, times a power of ten."""

FOREIGN_S: Final = 3600.0
"""Age beyond which a stamp is attributed to another clock, for example a recording's [s]."""


def status_words(status: int) -> tuple[tuple[str, str], ...]:
    """Words and styles of a status, most severe first; INVALID hides all other flags."""
    if status == OK:
        return (FINE,)
    if status & INVALID:
        return (STATUS[0][1:],)
    known = tuple((word, style) for flag, word, style in STATUS if status & flag)
    return known or ((f"FLAG {status}", "yellow"),)


def age_words(age_s: float) -> str:
    """How old an estimate is by its stamp, where this is of the same clock."""
    return f"age {max(age_s, 0.0):.3f} s" if abs(age_s) < FOREIGN_S else "recorded stamps"


def severity(status: int) -> int:
    """Place of the most severe flag in ``STATUS``, beyond the last one where there is none."""
    return next((k for k, (flag, *_) in enumerate(STATUS) if status & flag), len(STATUS))


def round_scale(largest: float) -> float:
    """Round up to one of a few scales, so that the scale of the bars changes rarely."""
    if not largest > 0.0:
        return 1.0
    power = 10.0 ** floor(log10(largest))
    return next(power * step for step in SCALES if power * step >= largest)
