"""What the estimator says on /diagnostics: its own status, and that of the robot's health."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.estimation.refusals import sparse_words
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.estimation.verdict_words import Level, Report
from cdrj_ros.foundation.output import listed, printable
from cdrj_ros.model.packing import INVALID, OVERLOAD, SLACK, UNSURE

WINDOW: Final = 4096
"""Number of latest steps over which the percentiles of the step time are computed."""

LEVELS: Final = {
    "ok": DiagnosticStatus.OK,
    "warn": DiagnosticStatus.WARN,
    "error": DiagnosticStatus.ERROR,
    "stale": DiagnosticStatus.STALE,
}
"""Levels of reports."""

LATE: Final = (
    "values up to 45 ms older than their stamps may cause most of it; if they are not, state the "
    "standard deviation of clock_offset of these axes (docs/estimation.md)"
)
"""What is said of elements that lags make ``UNSURE``."""

DOUBTED: Final = 0.1
"""A sensor whose probability of being right is smaller is reported."""


@dataclass
class StepTimes:
    """Durations of the latest steps."""

    _seconds: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW))
    count: int = 0

    def add(self, seconds: float) -> None:
        """Record the duration of one step [s]."""
        self._seconds.append(seconds)
        self.count += 1

    def percentiles_us(self) -> tuple[float, float]:
        """Median and 99th percentile [us]; zeros before the first step."""
        if self.count == 0:
            return 0.0, 0.0
        p50, p99 = np.percentile(self._seconds, (50, 99)) * 1e6
        return float(p50), float(p99)


class Health(NamedTuple):
    """State of the node's inputs and outputs."""

    timeout_s: float
    silence_s: float = 0.0
    """Time since the last estimate [s]; infinite before the first."""
    age_s: float = 0.0
    """Age of the last estimate as seen by a controller [s]; infinite before the first."""
    rate_hz: float = 0.0
    """Rate of published estimates [Hz]."""
    waiting: str = ""
    """Why there is no estimate yet."""
    refusing: str = ""
    """Why many readings are refused; empty if only a few are."""
    clock_refused: int = 0
    """Number of invalid times received on /clock."""
    clock: str = ""
    """What is wrong with a simulated clock; or empty."""
    misfit: str = ""
    """Why the readings do not fit the robot file; empty if they may."""
    alternating: str = ""
    """Axes whose readings alternate between two motions, and who publishes them; or empty."""
    other_estimators: str = ""
    """Who publishes the tensions, if several nodes do; otherwise empty."""
    heard: bool = False
    """Whether messages arrive."""
    by_arrival: tuple[str, ...] = ()
    """Topics whose times of arrival replace the stamps."""


def report_of(
    live: LiveEstimator, estimate: Estimate | None, health: Health, times: StepTimes
) -> Report:
    """What the estimator says of itself."""
    flagged = {
        flag: [name for name, one in estimate.statuses.items() if one & flag] if estimate else []
        for flag in (SLACK, OVERLOAD, UNSURE, INVALID)
    }
    found = Report("warn", f"waiting: {health.waiting}", {})
    if estimate is not None:
        found = _severest(live, estimate, flagged, health)
    if health.clock:
        level = "warn" if found.level == "ok" else found.level
        found = Report(level, f"{found.message}; {health.clock}", {}, (*found.named, "clock"))
    values = {
        "rate [Hz]": f"{health.rate_hz:.1f}",
        "age [s]": "none" if health.age_s == float("inf") else f"{health.age_s:.3f}",
        **_figures(live, flagged, times),
        "impossible times on /clock": str(health.clock_refused),
        "stamped on arrival": ", ".join(health.by_arrival) or "none",
    }
    return replace(found, values=values)


def status_of(name: str, report: Report, robot: str) -> DiagnosticStatus:
    """A report as DiagnosticStatus, whose hardware is a robot."""
    return DiagnosticStatus(
        level=LEVELS[report.level],
        name=name,
        message=printable(report.message),
        hardware_id=robot,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )


def _sensors(live: LiveEstimator) -> dict[str, float]:
    """Probability that every sensor that was heard is right, by name."""
    return live.corrections.right if live.corrections is not None else {}


def _steps(live: LiveEstimator) -> list[str]:
    robot = live.model.robot
    by = live.conditioner.displaced.items()
    return [f"{name} by {size:.3g} {robot.unit_of(name)}" for name, size in by]


def unread_axes(live: LiveEstimator) -> dict[str, str]:
    """For how long axes are not read for which others would no longer wait, in words by name."""
    silent = live.conditioner.silent
    return {name: f"{name} for {silent_ns * 1e-9:.1f} s" for name, silent_ns in silent.items()}


def _lags(live: LiveEstimator) -> list[str]:
    return [
        f"{name} by {lag_ns * 1e-6:.2g} ms, which grows by {growth * 1e6:.0f} ppm"
        for name, (lag_ns, growth) in live.conditioner.lagging.items()
    ]


def _sparse(live: LiveEstimator, rate_hz: float) -> str:
    """Axes read too seldom for their motion, so that this alone makes much of ``UNSURE``."""
    if live.sample is None or not len(live.sample.unseen) or rate_hz <= 0.0:
        return ""
    midway, worth = live.sample.unseen[1], live.conditioner.worth
    return sparse_words(live.model.robot, worth, midway, rate_hz, 0.5 * UNSURE_SHARE)


def _severest(
    live: LiveEstimator, estimate: Estimate, flagged: Mapping[int, list[str]], health: Health
) -> Report:
    """The most severe cause, by its name; none has a name that is logged elsewhere or often.

    Longer than a screen because it is one table, in the order of severity.
    """
    doubted = [name for name, right in _sensors(live).items() if right < DOUBTED]
    stepped, lagging, unread = _steps(live), _lags(live), [*unread_axes(live).values()]
    late = [name for name in live.late_elements(estimate) if name in flagged[UNSURE]]
    sparse = _sparse(live, health.rate_hz)
    refusing = f"; {health.refusing}" if health.refusing else ""
    deaf = live.encoderless is not None and live.encoderless.lacks_efforts
    silent = health.silence_s > health.timeout_s
    unused = f"no estimate for {health.timeout_s:g} s: {health.waiting}"
    causes: tuple[tuple[object, Level, str, str], ...] = (
        (silent and health.heard and health.waiting, "error", "", unused),
        (silent, "stale", "", f"no input for {health.timeout_s:g} s"),
        (deaf, "error", "no effort", "no effort of a motor: joints without encoder need it"),
        (
            unread, "error", "not read",
            f"no reading accepted of {listed(unread)}: nothing is known of its cables{refusing}",
        ),
        (health.misfit, "error", "misfit", health.misfit),
        (flagged[INVALID], "error", "not solved", f"not solved: {listed(flagged[INVALID])}"),
        (flagged[OVERLOAD], "error", "overload", f"overload: {listed(flagged[OVERLOAD])}"),
        (
            health.age_s > health.timeout_s, "warn", "age",
            f"estimates are {health.age_s:.3g} s old: a topic lags, or all inputs come late",
        ),
        (
            health.alternating, "warn", "alternating",
            f"readings contradict each other or alternate between motions: {health.alternating}",
        ),
        (
            live.conditioner.stuck, "warn", "old readings",
            f"readings are old although their stamps are new: {listed(live.conditioner.stuck)}",
        ),
        (health.other_estimators, "warn", "several estimators", health.other_estimators),
        (
            stepped, "warn", "steps",
            f"readings stepped further than the axis can move: {listed(stepped)}; ~/tare",
        ),
        (
            lagging, "warn", "lags",
            f"readings lag: {listed(lagging)}; a late topic, or another clock (clock_offset)",
        ),
        (
            live.misfitting, "warn", "joints misfit",
            f"misfit of motors and joints (unit?): {listed(live.misfitting)}",
        ),
        (
            doubted, "warn", "sensors",
            f"sensors that contradict the others or the robot: {listed(doubted)}",
        ),
        (health.refusing, "warn", "refused", health.refusing),
        (flagged[SLACK], "warn", "", f"slack: {listed(flagged[SLACK])}"),
        (flagged[UNSURE] and sparse, "warn", "sparse", f"unsure: {sparse}"),
        (late, "warn", "late", f"unsure: {listed(late)}: {LATE}"),
        (flagged[UNSURE], "warn", "", f"unsure: {listed(flagged[UNSURE])}"),
    )  # fmt: skip
    for holds, level, cause, message in causes:
        if holds:
            return Report(level, message, {}, (cause,) if cause else ())
    return Report("ok", "estimating", {})


def _figures(
    live: LiveEstimator, flagged: Mapping[int, list[str]], times: StepTimes
) -> dict[str, str]:
    """Counters and other values for the status message, by key."""
    p50, p99 = times.percentiles_us()
    conditioner = live.conditioner
    values = {
        "lag behind the newest reading [ms]": f"{conditioner.lag_ns * 1e-6:.3f}",
        "steps": str(times.count),
        "step time p50 [us]": f"{p50:.1f}",
        "step time p99 [us]": f"{p99:.1f}",
        "samples not solved": str(live.unsolved),
        "slack elements": ", ".join(flagged[SLACK]) or "none",
        "overloaded elements": ", ".join(flagged[OVERLOAD]) or "none",
        "unsure elements": ", ".join(flagged[UNSURE]) or "none",
        "preload [N]": ", ".join(f"{c.name} {c.preload:.6g}" for c in live.model.robot.cables),
        "readings accepted": str(conditioner.accepted),
        "clock jumps": str(conditioner.clock_jumps),
        "gaps": str(conditioner.gaps),
        "readings stepped": ", ".join(_steps(live)) or "none",
        "readings alternating": ", ".join(conditioner.alternating) or "none",
        "readings repeated": ", ".join(conditioner.stuck) or "none",
        "readings lagging": ", ".join(_lags(live)) or "none",
        "axes not read": ", ".join(unread_axes(live).values()) or "none",
        "readings held": str(conditioner.held),
        "readings for another topic": str(conditioner.elsewhere),
        "readings that waited too long": str(conditioner.crowded),
        **{f"refused: {cause}": str(n) for cause, n in conditioner.refused.items()},
        "refused: unknown sensor": str(live.readings.unknown),
        "sensor readings not used in time": str(live.readings.overlooked),
    }
    if live.corrections is not None:
        refused = live.readings.refused + live.corrections.refused
        values["sensor readings refused"] = str(refused)
        values |= {f"sensor {name}": words for name, words in live.corrections.words().items()}
    return values


def health_of(live: LiveEstimator) -> Report | None:
    """What the readings of sensors show about the robot; None without any."""
    found = live.report()
    if found is None:
        return None
    return replace(found, values={**found.values, "elements marked UNSURE": _marked(live)})


def _marked(live: LiveEstimator) -> str:
    """Elements that the verdict calls into doubt, in words."""
    assert live.corrections is not None
    doubted, names = live.corrections.doubted, live.model.layout.elements
    if not doubted.any():
        return "none"
    if doubted.all():
        return "all"
    return ", ".join(name for name, one in zip(names, doubted, strict=True) if one)


def diagnostic_array(stamp: object, *statuses: DiagnosticStatus) -> DiagnosticArray:
    """A DiagnosticArray with these statuses."""
    array = DiagnosticArray(status=list(statuses))
    array.header.stamp = stamp
    return array
