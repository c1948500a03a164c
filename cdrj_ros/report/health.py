"""Verdict of the health monitor on a recording, in lines of text."""

from __future__ import annotations

from cdrj_ros.health.recorded import Alarm, Verdict
from cdrj_ros.judgement.channels import BagComparison


def health_of(bag: BagComparison) -> list[str]:
    """The verdict in lines that name the recording; none if the monitor did not run."""
    lines = health_lines(bag.health) if bag.health else []
    return [f"health: {bag.path}: {line}" for line in lines]


def health_lines(verdict: Verdict) -> list[str]:
    """The verdict first, then one line for every alarm."""
    sensors = ", ".join(verdict.sensors)
    compared = f"{_counted(verdict.cycles)} compared by {sensors}"
    if not verdict.alarms:
        return [f"{verdict.message} ({compared})"]
    return [f"alarm ({compared})", *(_line(one) for one in verdict.alarms)]


def _line(alarm: Alarm) -> str:
    if alarm.first_cycle == alarm.last_cycle:
        cycles = f"cycle {alarm.first_cycle}"
    else:
        cycles = f"cycles {alarm.first_cycle} to {alarm.last_cycle}"
    span = f"{alarm.begin_s:.1f} to {alarm.end_s:.1f} s"
    return f"{alarm.level}, {cycles}, {span}: {alarm.message}"


def _counted(cycles: int) -> str:
    return "1 cycle" if cycles == 1 else f"{cycles} cycles"
