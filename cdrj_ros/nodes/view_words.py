"""The state of an estimator in words, for the page."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import monotonic
from typing import Any, Final

from cdrj_ros.nodes.feed import Rate
from cdrj_ros.report.live_table import FOREIGN_S
from cdrj_ros.view.html import filled

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

    def diagnose(self, status: Any) -> None:
        """Store a DiagnosticStatus."""
        self.diagnosis, self.diagnosed_s = status, monotonic()


def words_of(heard: Heard, publishers: int, now_ns: int) -> tuple[str, ...]:
    """The state in paragraphs, see ``markup.plain``.

    Args:
        heard: what has been received.
        publishers: number of publishers of its tensions.
        now_ns: time of the clock with which stamps are compared [ns].
    """
    rate = heard.rate.hz(heard.count)
    if heard.fresh:
        state = (
            "<b>Stale:</b> the estimator's inputs are late" if heard.stale else "<b>Estimating</b>"
        )
        hertz = "" if rate is None else f" · {rate:.0f} Hz"
        age_s = (now_ns - heard.stamp_ns) * 1e-9
        foreign = abs(age_s) > FOREIGN_S
        age = "recorded stamps" if foreign else f"age {1e3 * max(age_s, 0.0):.0f} ms"
        return (filled(state + "{} · {}", hertz, age), *_diagnosed(heard))
    since = f"{monotonic() - heard.last_s:.0f} s"
    if not publishers and heard.count:
        words = "<b>No estimator:</b> {} is gone, its last tensions are {} old"
        return (filled(words, heard.node, since), *_diagnosed(heard))
    if not publishers:
        words = "<b>No estimator:</b> nobody publishes {}"
        return (filled(words, heard.topic), *_diagnosed(heard))
    silent = f"for {since}" if heard.count else "yet"
    return (filled("<b>No tensions</b> on {} {}", heard.topic, silent), *_diagnosed(heard))


def _diagnosed(heard: Heard) -> tuple[str, ...]:
    """Message and some values of the last diagnosis, unless it is old."""
    status = heard.diagnosis
    if status is None or monotonic() - heard.diagnosed_s > DIAGNOSED_S:
        return ()
    values = {value.key: value.value for value in status.values}
    message = f"{LEVELS.get(status.level, '?')}: {status.message}"
    kept = [f"{key} {values[key]}" for key in SHOWN if values.get(key, "none") != "none"]
    return (message, *([filled("<small>{}</small>", " · ".join(kept))] if kept else []))
