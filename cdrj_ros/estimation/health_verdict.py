"""What a verdict of the health monitor says to people, and which elements it calls into question.

While the readings show that the robot differs from its file, the estimates of the cables concerned
are wrong by more than their standard deviation may say, so they must not have the status OK.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.health_changes import Change, is_effort
from cdrj_ros.estimation.health_evaluation import Evaluation, Found
from cdrj_ros.robot.description import Robot

Flags = NDArray[np.bool_]

FALLING: Final = 4
"""Cycles over which a preload must fall steadily to be called falling."""

LEAST_RATIO: Final = 0.01
"""Smallest ratio of a measured effort to the expected one that tells a scale."""

NOTHING: Final = (
    "no motor effort and no load cell: angles alone show neither lost preloads nor friction"
)


Level = Literal["ok", "warn", "error"]


@dataclass(frozen=True)
class Report:
    """The verdict for people."""

    level: Level
    """``warn``: the robot differs from its file by more than the file leaves open; ``error``: a
    cable carries nothing."""
    message: str
    values: dict[str, str]
    """Figures by name."""


def report(
    robot: Robot,
    sensors: Sequence[str],
    cycles: int,
    standing: Evaluation | None,
    evaluated: Sequence[Evaluation],
) -> Report:
    """Put the state of the monitor into words.

    Args:
        robot: the robot.
        sensors: sensors that have sent a reading.
        cycles: number of cycles compared so far.
        standing: the present verdict; None while the robot agrees with its file.
        evaluated: results of the latest cycles.
    """
    last = evaluated[-1] if evaluated else None
    values = {"sensors": ", ".join(sensors) or "none", "cycles compared": str(cycles)}
    if last is not None:
        for name, (before, after) in last.deviation.items():
            unit = "N m" if is_effort(robot, name) else "N"
            values[f"deviation of {name} [{unit}]"] = (
                f"{before:.3g} from the file, {after:.3g} from it with what the last cycle shows"
            )
        if last.constant:
            values["constant, so not compared"] = ", ".join(last.constant)
        values["seen in the last cycle"] = "; ".join(map(_amount, last.found)) or "no change"
    if not sensors:
        return Report("ok", NOTHING, values)
    if standing is None:
        text = "agrees with the robot file" if cycles else "waiting for two cycles of motion"
        return Report("ok", text, values)
    if not standing.explained:
        return Report("warn", _unexplained(robot, standing), values)
    text = "; ".join(_sentence(robot, one, evaluated) for one in standing.found if one.matters)
    broken = any(one.change.kind == "broken" for one in standing.found)
    return Report("error" if broken else "warn", text, values)


def unsure_elements(robot: Robot, standing: Evaluation | None, *, corrected: bool) -> Flags:
    """Whether each element's tension is in question, shape (elements,).

    A change of one cable that nothing else explains as well concerns that cable.  Every other
    verdict concerns all elements: one effort seldom tells the changes of several cables apart.

    Args:
        robot: the robot as its file describes it.
        standing: the verdict; None while the robot agrees with its file.
        corrected: whether efforts or load cells correct the estimate; its standard deviation then
            contains what they leave open, and only a cable that carries nothing is a reason, or
            what no change explains.
    """
    flags = robot.per_element(np.zeros(len(robot.cables), dtype=np.bool_))
    if standing is None:
        return flags
    if not standing.explained:
        return ~flags
    for found in standing.found:
        if found.matters and not (corrected and found.change.kind != "broken"):
            concerned = _cables(robot, found.change, sole=not found.others)
            flags |= robot.per_element(concerned)
    return flags


def _cables(robot: Robot, change: Change, *, sole: bool) -> list[bool]:
    """Whether each cable is concerned by a change."""
    if change.kind in ("preload", "broken") and sole and change.robot is not None:
        return [a != b for a, b in zip(robot.cables, change.robot.cables, strict=True)]
    return [True] * len(robot.cables)


def _unexplained(robot: Robot, evaluated: Evaluation) -> str:
    worst = max(evaluated.deviation, key=lambda name: evaluated.deviation[name][1])
    before, after = evaluated.deviation[worst]
    unit = "N m" if is_effort(robot, worst) else "N"
    return (
        f"{worst} is {before:.3g} {unit} off, of which no single change of the robot explains "
        f"{after:.3g} {unit}: wrong robot file, wrong sign or unit of a sensor, or several changes"
    )


def _amount(found: Found) -> str:
    one = found.change
    if one.kind == "broken":
        return f"{one.what} carries nothing"
    return f"{one.what} {found.amount:+.3g} +- {found.stddev:.2g} {one.unit}"


def _sentence(robot: Robot, found: Found, evaluated: Sequence[Evaluation]) -> str:
    one = found.change
    size, error = f"{abs(found.amount):.3g}", f"{found.stddev:.2g}"
    more = found.amount > 0.0
    if one.kind == "broken":
        text = f"{one.what} carries nothing: it is broken or off its drum"
        return text + (f" (or: {', '.join(found.others)})" if found.others else "")
    if one.kind == "zero":
        text = f"{one.what} is off: it reads {size} +- {error} {one.unit} too "
        text += "much" if more else "little"
    elif one.kind == "sensor":
        text = f"{one.what} is {size} +- {error} {one.unit} too {'high' if more else 'low'}"
        text += _remedy(robot, found)
    elif one.kind == "preload":
        what = "risen" if more else "lost"
        text = f"{one.what} has {what} {size} +- {error} {one.unit}"
        preload = next((c.preload for c in robot.cables if one.what == f"preload of {c.name}"), 0.0)
        if preload:
            text += f" of {preload:.4g} N"
        text += "" if more else _course(one.what, evaluated)
    else:
        text = f"{one.what} is {size} +- {error} {one.unit} {'more' if more else 'less'} than in "
        text += "the robot file"
    if found.others:
        text += f" (or: {', '.join(found.others[:3])})"
    return text


def _remedy(robot: Robot, found: Found) -> str:
    """The key that mends the scale of an effort, and its value."""
    one = found.change
    ratio = 1.0 + found.amount / one.size * one.gain
    motor = next((m for m in robot.motors if m.name == one.channel), None)
    if motor is None or not one.gain or abs(ratio) < LEAST_RATIO:
        return ""
    return f"; if its unit is wrong, effort_scale: {motor.effort_scale / ratio:.4g} mends it"


def _course(what: str, evaluated: Sequence[Evaluation]) -> str:
    """Whether a preload fell at once, or still falls."""
    amounts = [
        next((one.amount for one in cycle.found if one.change.what == what), 0.0)
        for cycle in evaluated
    ]
    latest = amounts[-FALLING:]
    steps = [after - before for before, after in pairwise(latest)]
    if len(latest) == FALLING and all(step < 0.03 * latest[-1] for step in steps):
        return (
            f", {-sum(steps) / len(steps):.2g} more in every cycle: it slips on its drum, or creeps"
        )
    begun = next((k for k, one in enumerate(amounts) if one < 0.5 * amounts[-1] < 0.0), 0)
    if begun >= 1 and not evaluated[max(begun - 2, 0)].found:
        return " at once: a drum slipped or an anchor yielded"
    return ""
