"""What the estimator says of itself on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.model.mechanism import INVALID, OVERLOAD, SLACK

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
    hardware: str,
    estimate: Estimate | None,
    rate_hz: float,
    age_s: float | None,
    timeout_s: float,
    times: StepTimes,
    unsolved: int,
    refused: Mapping[str, int],
) -> DiagnosticStatus:
    """One DiagnosticStatus of the estimator."""
    slack = names_with(estimate, SLACK) if estimate else []
    overload = names_with(estimate, OVERLOAD) if estimate else []
    invalid = names_with(estimate, INVALID) if estimate else []
    level, message = DiagnosticStatus.OK, "estimating"
    if estimate is None:
        level, message = DiagnosticStatus.WARN, "waiting for every motor and joint"
    elif age_s is None or age_s > timeout_s:
        level, message = DiagnosticStatus.STALE, f"no input for {timeout_s:g} s"
    elif invalid:
        level, message = DiagnosticStatus.ERROR, f"not solved: {', '.join(invalid)}"
    elif overload:
        level, message = DiagnosticStatus.ERROR, f"overload: {', '.join(overload)}"
    elif slack:
        level, message = DiagnosticStatus.WARN, f"slack: {', '.join(slack)}"
    p50, p99 = times.percentiles_us()
    values = {
        "rate [Hz]": f"{rate_hz:.1f}",
        "age [s]": "none" if age_s is None else f"{age_s:.3f}",
        "steps": str(times.count),
        "step time p50 [us]": f"{p50:.1f}",
        "step time p99 [us]": f"{p99:.1f}",
        "samples not solved": str(unsolved),
        "slack elements": ", ".join(slack) or "none",
        "overloaded elements": ", ".join(overload) or "none",
        **{f"refused: {cause}": str(count) for cause, count in refused.items()},
    }
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id=hardware,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


def diagnostic_array(stamp: object, status: DiagnosticStatus) -> DiagnosticArray:
    """The message that carries one status."""
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array
