"""The state of a running estimator in words, for the page in a browser."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import monotonic
from typing import Any, Final

from cdrj_ros.foundation.text import printable
from cdrj_ros.nodes.feed import Rate
from cdrj_ros.report.live_table import FOREIGN_S

DIAGNOSED_S: Final = 3.0
"""Time after which a diagnosis is no longer shown [s]."""

LEVELS: Final = {b"\x00": "OK", b"\x01": "WARN", b"\x02": "ERROR", b"\x03": "STALE"}
"""Words of the levels of a DiagnosticStatus."""

SHOWN: Final = (
    "step time p50 [us]", "step time p99 [us]", "lag behind the newest reading [ms]",
    "slack elements", "overloaded elements", "unsure elements", "readings stepped",
)  # fmt: skip
"""Values of the diagnosis that the page shows."""


@dataclass
class Heard:
    """What has been received from the estimator."""

    topic: str
    """Of its tensions."""
    node: str
    """Its full name."""
    last_s: float = field(default_factory=lambda: -float("inf"))
    """Steady time of its last message [s]."""
    fresh: bool = False
    """Whether its tensions are not older than allowed."""
    stale: bool = False
    """Whether the estimator marks all of them STALE itself."""
    stamp_ns: int = 0
    """Stamp of the last tensions [ns]."""
    count: int = 0
    diagnosis: Any = None
    """Its last DiagnosticStatus."""
    diagnosed_s: float = -float("inf")
    """Steady time of the last diagnosis [s]."""
    rate: Rate = field(default_factory=Rate)

    def note(self) -> None:
        """Count a message with tensions."""
        self.last_s, self.count = monotonic(), self.count + 1

    def diagnose(self, status: Any) -> None:
        """Store a DiagnosticStatus."""
        self.diagnosis, self.diagnosed_s = status, monotonic()


def words_of(heard: Heard, there: bool, publishers: int, now_ns: int) -> tuple[str, ...]:
    """The state as paragraphs of Markdown.

    Args:
        heard: what has been received.
        there: whether the estimator offers its services.
        publishers: number of publishers of its tensions.
        now_ns: time of the clock with which stamps are compared [ns].
    """
    rate = heard.rate.hz(heard.count)
    if heard.fresh:
        facts = ["**Stale:** the estimator's inputs are late" if heard.stale else "**Estimating**"]
        if rate is not None:
            facts.append(f"{rate:.0f} Hz")
        age_s = (now_ns - heard.stamp_ns) * 1e-9
        foreign = abs(age_s) > FOREIGN_S
        facts.append("recorded stamps" if foreign else f"age {1e3 * max(age_s, 0.0):.0f} ms")
        return (" · ".join(facts), *_diagnosed(heard))
    since = monotonic() - heard.last_s
    if not there and not publishers:
        gone = "**No estimator:** " + (
            f"{heard.node} is gone, its last tensions are {since:.0f} s old"
            if heard.count
            else f"nobody publishes {heard.topic}, and {heard.node} is not running"
        )
        return (gone,)
    if not publishers:
        return (f"**No tensions:** nobody publishes {heard.topic}", *_diagnosed(heard))
    silent = f"for {since:.0f} s" if heard.count else "yet"
    return (f"**No tensions** on {heard.topic} {silent}", *_diagnosed(heard))


def _diagnosed(heard: Heard) -> tuple[str, ...]:
    """Message and some values of the last diagnosis, unless it is old."""
    status = heard.diagnosis
    if status is None or monotonic() - heard.diagnosed_s > DIAGNOSED_S:
        return ()
    values = {value.key: value.value for value in status.values}
    lines = [f"{LEVELS.get(status.level, '?')}: {printable(status.message)}"]
    kept = [f"{key} {printable(values[key])}" for key in SHOWN if values.get(key, "none") != "none"]
    if kept:
        lines.append("<small>" + " · ".join(kept) + "</small>")
    return tuple(lines)
