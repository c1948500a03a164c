"""What readings show of a robot, its motors and its sensors, said to people, and in which order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp
from typing import Final, Literal

from cdrj_ros.estimation.unknowns import PRELOAD, ZERO
from cdrj_ros.estimation.verdicts import ALL_EFFORTS, BIAS, GAIN, Finding, Verdict
from cdrj_ros.robot.description import Robot, Winch

CLEAR: Final = 14.0
"""Margin beyond which no exact figure is said: a million."""

EVEN: Final = 0.7
"""Margin below which another change is as likely: a factor of two."""

LEAST_RATIO: Final = 0.01
"""Smallest ratio of a measured effort to the expected one that tells a scale."""

SMALL_OR_LARGE: Final = 3.0
"""Factor up to which a wrong radius of a drum explains an effort, or a travel, as well."""

REVERSED: Final = 0.2
"""Largest difference from -1 of the factor of a drum that winds, or a sign, the other way."""

Level = Literal["ok", "warn", "error", "stale"]


@dataclass(frozen=True)
class Report:
    """What is found of a robot and its sensors, for people."""

    level: Level
    """Of sensors, ``warn``: the robot or one of them differs from the file by more than the file
    leaves open; ``error``: a cable carries nothing."""
    message: str
    values: dict[str, str]
    """Figures by name."""
    named: tuple[str, ...] = ()
    """The changes, or causes, that ``message`` names."""


def report(robot: Robot, verdicts: Sequence[Verdict | None], travel: str = "") -> Report:
    """Put into words what is found.

    A motor that turns otherwise than its cables allow looks like many changes, and is said in their
    place.  A broken cable and a joint's zero look like it, and are said beside it; a zero that
    explains all readings is said first, since it is one change for several motors.

    Args:
        robot: the robot.
        verdicts: of all groups.
        travel: what is said of its motors, see ``MotorTravel``; empty for nothing.
    """
    judged = [one for one in verdicts if one is not None]
    found = _of_verdicts(robot, judged)
    if not travel:
        return found
    kinds = {one.change.kind.name for verdict in judged for one in verdict.found if one.matters}
    if ZERO.name in kinds and all(one.explained for one in judged):
        return replace(found, message=f"{found.message}; or {travel}")
    if found.level == "error" or ZERO.name in kinds:
        return replace(found, message=f"{travel}; or {found.message}")
    return replace(found, level="warn", message=travel, named=("travel",))


def _of_verdicts(robot: Robot, judged: Sequence[Verdict]) -> Report:
    """The verdicts of all groups that have one."""
    if not judged:
        return Report("ok", "too few readings of sensors", {})
    words: dict[str, str] = {}
    for what, text in (line for one in judged for line in _words(robot, one)):
        words.setdefault(what, text)  # a joint, or a cause, of several groups is said once
    values = {
        f"deviation of {name} [{_unit(robot, name)}]": f"{file:.3g} from the file, "
        f"{found:.3g} from it with what is found"
        for one in judged
        for name, (file, found) in one.deviation.items()
    }
    found = [
        f"{one.change.what} {one.amount:+.3g} +- {one.stddev:.2g} {one.change.unit}"
        for verdict in judged
        for one in verdict.found
    ]
    values["found"] = "; ".join(found) or "no change"
    broken = any(one.broken for one in judged)
    level: Level = "error" if broken else "warn" if words else "ok"
    named = tuple(name for one in judged for name in (one.broken, *one.named) if name)
    agrees = "agrees with the robot file"
    if not any(one.deviation for one in judged):
        agrees = "nothing to compare: the sensors repeat their readings"
    return Report(level, "; ".join(words.values()) or agrees, values, named)


def _unit(robot: Robot, sensor: str) -> str:
    return "N m" if any(axis.name == sensor for axis in robot.axes) else "N"


def _words(robot: Robot, verdict: Verdict) -> list[tuple[str, str]]:
    """What is said of a group, by what it is about."""
    if verdict.broken:
        text = f"cable {verdict.broken} carries nothing: it is broken or off its drum"
        of_sensors = [f.change.what for f in verdict.found if f.change.kind in (GAIN, BIAS)]
        others = ", ".join(of_sensors if verdict.explained else ())
        return [(text, f"{text} (or: {others})" if others else text)]
    if verdict.opposite:
        text = _opposite(robot, verdict.opposite)
        return [(text, text)]
    if verdict.swapped:
        text = swap(*verdict.swapped)
        return [(text, text)]
    if not verdict.explained and verdict.times > 1.0:
        text = f"efforts are {verdict.times:.3g} times what the cables' pull gives"
        key = f"effort_scale: {1.0 / verdict.times:.3g} times as much"
        return [("times", f"{text}: {key} mends it")]
    if not verdict.explained:
        worst = max(verdict.deviation, key=lambda name: verdict.deviation[name][1])
        (file, found), unit = verdict.deviation[worst], _unit(robot, worst)
        text = (
            f"{worst} is {file:.3g} {unit} off, of which no single change explains "
            f"{found:.3g} {unit}: wrong robot file, wrong sign or unit of a sensor, or "
            "several changes"
        )
        return [("unexplained", text)]
    return [(one.change.what, _sentence(robot, one)) for one in verdict.found if one.matters]


def swap(one: str, other: str) -> str:
    """Two axes or sensors that read what the other should."""
    return f"the readings of {one} and {other} seem to be swapped: exchange their names"


def turn(robot: Robot, name: str, ratio: float) -> str:
    """A motor that turns ``ratio`` times as far as its cables allow, and the keys that fit."""
    (motor,) = (one for one in robot.motors if one.name == name)
    text = f"{name} turns {abs(ratio):.3g} times as far as its cables allow"
    fits = f"scale: {motor.sensor.scale / ratio:.4g}"
    if ratio < 0.0:
        text += ", the other way"
    drums = {(drum.winding, drum.radius) for drum in _drums(robot, name)}
    of_drum = ", or radius or winding of one of its drums" if len(drums) > 1 else ""
    if len(drums) == 1:
        ((winding, radius),) = drums
        if abs(ratio + 1.0) < REVERSED:
            way = f"{name} turns the other way than its cables allow"
            return f"{way}: winding: {-winding} or {fits} would fit"
        if 1.0 / SMALL_OR_LARGE < ratio < SMALL_OR_LARGE:
            return f"{text}: {fits} or a drum of radius_mm: {1e3 * radius / ratio:.3g} would fit"
    return f"{text}: gear ratio, unit or sign? {fits} would fit{of_drum}"


def _drums(robot: Robot, motor: str) -> list[Winch]:
    """The drums that a motor turns."""
    drums = [node for cable in robot.cables for node in cable.nodes if isinstance(node, Winch)]
    return [drum for drum in drums if motor in dict(drum.motors)]


def _opposite(robot: Robot, names: Sequence[str]) -> str:
    """Sensors that read what only a cable that pushes would give, and the keys that mend them."""
    motors = [one for one in robot.motors if one.name in names]
    fits = [f"motors.{one.name}.effort_sign: {-one.effort_sign:+d}" for one in motors]
    cells = [name for name in names if all(axis.name != name for axis in robot.axes)]
    other = ", or the other winding" if len(fits) < len(robot.motors) else ""
    if len({one.effort_sign * one.effort_scale > 0.0 for one in motors}) == len(motors) == 2:
        other += ", or their readings are swapped: exchange their names"
    words = [f"efforts are opposite to the cables' pull; {', '.join(fits)} fits{other}"]
    words = words if fits else []
    words += [f"load cell {name} reads a cable that pushes: change its sign" for name in cells]
    return "; ".join(words)


def _sentence(robot: Robot, found: Finding) -> str:
    one, others = found.change, found.others
    size = f"{abs(found.amount):.3g} +- {found.stddev:.2g} {one.unit}"
    text = one.kind.said[found.amount < 0.0].format(what=one.what, size=size)
    if one.kind is PRELOAD:
        file = [c.preload for c in robot.cables if one.what == f"preload of {c.name}"]
        text += "".join(f" of {preload:.4g} N" for preload in file)
        ratio = 1.0 + found.amount / (file[0] if file else 100.0)
        keys = [_effort_scale(robot, name, ratio) for name in others]
        others = tuple(
            f"{name} with {key}" if key else name for name, key in zip(others, keys, strict=True)
        )
    elif one.kind is GAIN:
        text += _remedy(robot, found)
    return f"{text} ({_likelihood(others, found.margin)})"


def _likelihood(others: Sequence[str], margin: float) -> str:
    """How much likelier a change is than the others, and those that explain the readings, too."""
    if not others:
        times = "over a million" if margin > CLEAR else f"{exp(margin):,.0f}"
        return f"{times} times likelier than any other change"
    named = ", ".join(others[:3])
    return f"or: {named}" if margin < EVEN else f"{exp(margin):.0f} times likelier than {named}"


def _effort_scale(robot: Robot, what: str, ratio: float) -> str:
    """The key that mends efforts read too large by a factor, if the change is of their scale."""
    if abs(ratio) < LEAST_RATIO:
        return ""
    if what == ALL_EFFORTS:
        return f"effort_scale: {1.0 / ratio:.3g} times as much"
    scales = {f"scale of effort of {axis.name}": axis.effort_scale for axis in robot.axes}
    return f"effort_scale: {scales[what] / ratio:.4g}" if what in scales else ""


def _remedy(robot: Robot, found: Finding) -> str:
    """The keys that mend the scale of an effort, or of all, and their values."""
    one, ratio = found.change, 1.0 + found.amount / found.change.factor
    if abs(ratio + 1.0) < max(REVERSED, found.stddev / one.factor):
        of_all = "their signs are" if one.what == ALL_EFFORTS else "its sign is"
        return f"; if {of_all} wrong, the other effort_sign mends it"
    key = _effort_scale(robot, one.what, ratio)
    if not key:
        return ""
    if one.what == ALL_EFFORTS:
        text = f"; if their unit is wrong, {key} mends it"
        return text + (f"; if that of the preloads is, {ratio:.3g} times" if ratio > 0.0 else "")
    text = f"; if its unit is wrong, {key} mends it"
    name = one.what.removeprefix("scale of effort of ")
    cables = [cable for cable in robot.cables if name in cable.motors]
    if len(cables) == 1 and ratio > 0.0:
        text += f"; if its preload is, {ratio * cables[0].preload:.4g} N"
    radii = {drum.radius for drum in _drums(robot, name)}
    if len(radii) == 1 and 1.0 / SMALL_OR_LARGE < ratio < SMALL_OR_LARGE:
        text += f"; if its drum is, radius_mm: {1e3 * ratio * radii.pop():.3g}"
    return text
