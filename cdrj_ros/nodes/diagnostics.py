"""What the estimator says of itself on /diagnostics."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.estimation.session import LiveEstimator, Output
from cdrj_ros.model.status import INVALID, OVERLOAD, SLACK, UNSURE

WINDOW = 4096
"""Steps over which the step time is judged."""


@dataclass
class StepTimes:
    """Durations of the latest steps."""

    _seconds: np.ndarray = field(default_factory=lambda: np.zeros(WINDOW))
    count: int = 0

    def add(self, seconds: float) -> None:
        """Remember one step [s]."""
        self._seconds[self.count % WINDOW] = seconds
        self.count += 1

    def percentiles_us(self) -> tuple[float, float]:
        """Median and 99th percentile [us]; zeros before the first step."""
        if self.count == 0:
            return 0.0, 0.0
        p50, p99 = np.percentile(self._seconds[: min(self.count, WINDOW)], (50, 99)) * 1e6
        return float(p50), float(p99)


def names_with(estimate: Estimate, flag: int) -> list[str]:
    """Elements that carry a status flag."""
    flags = estimate.status.astype(np.uint8)
    return [
        name for name, value in zip(estimate.layout.elements, flags, strict=True) if value & flag
    ]


def status_of(
    name: str,
    live: LiveEstimator,
    output: Output | None,
    rate_hz: float,
    age_s: float | None,
    timeout_s: float,
    times: StepTimes,
) -> DiagnosticStatus:
    """One DiagnosticStatus of the estimator; times are those of the node's clock."""
    estimate = output.estimate if output else None
    flagged = {
        flag: names_with(estimate, flag) if estimate else []
        for flag in (SLACK, OVERLOAD, UNSURE, INVALID)
    }
    health = live.fusion.health.values() if live.fusion else ()
    stepped = [f"{name} by {by:.3g} rad" for name, by in live.conditioner.displaced.items()]
    dropped = {one.name: one.dropped for one in health if one.dropped}
    level, message = DiagnosticStatus.OK, "estimating"
    if estimate is None:
        level, message = DiagnosticStatus.WARN, "waiting for every motor and joint"
    elif age_s is None or age_s > timeout_s:
        level, message = DiagnosticStatus.STALE, f"no input for {timeout_s:g} s"
    elif flagged[INVALID]:
        level, message = DiagnosticStatus.ERROR, f"not solved: {', '.join(flagged[INVALID])}"
    elif flagged[OVERLOAD]:
        level, message = DiagnosticStatus.ERROR, f"overload: {', '.join(flagged[OVERLOAD])}"
    elif stepped:
        level = DiagnosticStatus.WARN
        message = f"readings stepped further than the axis can move: {', '.join(stepped)}; ~/tare"
    elif dropped:
        level = DiagnosticStatus.WARN
        message = "; ".join(f"sensor {one} dropped: {why}" for one, why in dropped.items())
    elif flagged[SLACK]:
        level, message = DiagnosticStatus.WARN, f"slack: {', '.join(flagged[SLACK])}"
    elif flagged[UNSURE]:
        level, message = DiagnosticStatus.WARN, f"unsure: {', '.join(flagged[UNSURE])}"
    p50, p99 = times.percentiles_us()
    conditioner = live.conditioner
    values = {
        "rate [Hz]": f"{rate_hz:.1f}",
        "age [s]": "none" if age_s is None else f"{age_s:.3f}",
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
        "readings stepped": ", ".join(stepped) or "none",
        "readings held": str(conditioner.held),
        "readings for another topic": str(conditioner.elsewhere),
        "readings that waited too long": str(conditioner.crowded),
        **{f"refused: {cause}": str(n) for cause, n in conditioner.refused.items()},
    }
    if live.fusion:
        values["refused: unknown element"] = str(live.unknown_elements)
        values["sensor readings not used in time"] = str(live.overlooked)
    for one in health:
        said = f"dropped: {one.dropped}" if one.dropped else "used"
        values[f"sensor {one.name}"] = f"{said}; {one.used} readings used, {one.refused} refused"
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id=live.model.robot.name,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


def diagnostic_array(stamp: object, status: DiagnosticStatus) -> DiagnosticArray:
    """The message that carries one status."""
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array
