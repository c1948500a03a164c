"""Measurements that contradict each other in a way that names the mistake.

A fit would put such a mistake into numbers of the robot: efforts of the wrong sign or unit, or
readings of a spring scale that were noted for each other's cables.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from cdrj_ros.commands.commission_steps import Commissioned
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.parts import PartFit
from cdrj_ros.model.packing import EFFORT, channel_columns
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.parameters import find_number

OPPOSITE: Final = -1.0 / 3.0
"""Ratio of efforts below which their sign is wrong: that of a cable never changes."""

UNIT: Final = 5.0
"""Ratio of all efforts, or its inverse, beyond which a unit is wrong and no load the reason,"""

ALIKE: Final = 1.5
"""and by what factor the ratios of motors may then differ."""

APART: Final = 1.05
"""Ratio of two readings below which it does not matter to which cable they belong."""

BETTER: Final = 3.0
"""Factor by which the largest deviation must fall for two readings to be swapped."""

MOVED: Final = 0.5
"""Share of a joint's range from which a motion shows what depends on its angle."""

UNUSUAL: Final = 3.0
"""A number that a measurement or a fit moves by so many of its standard deviations is reported."""

MEASURED: Final[Mapping[str, str]] = {
    "reference_angle": "does --rest begin in the reference pose?",
    "preload": "is --preload of this cable, and in N?",
    "radius": "does --drum give the diameter, in mm?",
}
"""What may be wrong with a measurement that moves a number far, by the number's key."""


def refuse_efforts(model: Model, recorded: Recorded) -> None:
    """Refuse efforts that push the cables, or that no cable with such preloads has.

    Args:
        model: the robot, with its preloads as they were read.
        recorded: a motion with efforts of motors.

    Raises:
        UsageError: names the motors and what to change.
    """
    ratios = effort_ratios(model, recorded)
    motors = {motor.name: motor for motor in model.robot.motors}
    wrong = [name for name, ratio in ratios.items() if ratio < OPPOSITE]
    if wrong:
        fits = ", ".join(
            f"motors.{one}.effort_sign: {-motors[one].effort_sign:+d}" for one in wrong
        )
        raise UsageError(f"{recorded.name}: efforts are opposite to the cables' pull; {fits} fits")
    least, most = min(ratios.values(), default=1.0), max(ratios.values(), default=1.0)
    if 0.0 < most < ALIKE * least and not 1.0 / UNIT < most < UNIT:
        fits = ", ".join(f"{motors[one].effort_scale / ratio:.4g}" for one, ratio in ratios.items())
        raise UsageError(
            f"{recorded.name}: efforts are {least:.3g} to {most:.3g} times what the preloads give; "
            f"effort_scale: {fits} fits, or the preloads are not in N (1 kgf is 9.81 N)"
        )


def unmoved(robot: Robot, recorded: Recorded) -> dict[str, float]:
    """Joints that a motion leaves nearly at rest, and the share of their ranges that it covers."""
    found = {}
    for joint in robot.joints:
        covered = abs(joint.sensor.scale) * float(np.ptp(recorded.joints[joint.name].value))
        whole = joint.upper - joint.lower
        if covered < MOVED * whole:
            found[joint.name] = covered / whole
    return found


def swapped(now: Commissioned) -> tuple[str, str] | None:
    """Two cables whose readings on a spring scale fit the recordings only the other way round.

    Tried where a fit leaves far more than the noise of its sensors, or moves a number far.
    """
    found, least, readings = None, _worst(now.fits) / BETTER, now.measured.preload
    read = {name.split("/")[0]: value for row in readings[:1] for name, value in row.items()}
    for fit in now.fits:
        own = [cable.name for cable in fit.part.robot.cables if cable.name in read]
        for pair in combinations(own if _worst([fit]) > UNUSUAL else (), 2):
            first, second = sorted(read[cable] for cable in pair)
            if second < APART * first:
                continue
            other = _worst(now.also(preload=[_exchanged(row, pair) for row in readings]).fits)
            if other < least:
                found, least = pair, other
    return found


def _worst(fits: Sequence[PartFit]) -> float:
    """The largest deviation: residual over noise, or change of a number over its deviation."""
    left = [one.rms / one.noise for fit in fits for one in fit.found.unexplained.values()]
    return max([*left, *(float(np.abs(fit.found.values).max(initial=0.0)) for fit in fits)])


def unlikely(before: Commissioned, now: Commissioned) -> Iterator[str]:
    """Numbers that the last measurement has moved far from what the file knew of them."""
    robot, measured = before.model.robot, dict(now.unfitted.robot.document)
    known = robot.uncertainty.stddev if robot.uncertainty else {}
    for path in sorted((now.origins.keys() - before.origins.keys()) & known.keys()):
        was, is_now = find_number(dict(robot.document), path), find_number(measured, path)
        if abs(is_now.value - was.value) > UNUSUAL * known[path] > 0.0:
            yield (
                f"{path} is {is_now.value:.4g} now, the file has {was.value:.4g} +- "
                f"{known[path]:.2g}: {MEASURED[was.key]}"
            )


def unusual(fit: PartFit) -> list[str]:
    """Numbers that a fit has moved far from what was known of them."""
    return [
        f"{one.paths[0]} became {one.shifts[0] + value * one.factors[0]:.4g} instead of "
        f"{one.shifts[0]:.4g}, by {abs(value):.2g} standard deviations: is this number wrong, or "
        "one that it stands for, such as the gear (scale) for a drum's radius?"
        for one, value in zip(fit.found.unknowns, fit.found.values.tolist(), strict=True)
        if abs(value) > UNUSUAL
    ]


def _exchanged(row: Mapping[str, float], pair: tuple[str, str]) -> dict[str, float]:
    """The readings in a pose with those of two cables exchanged."""
    names = [[name for name in row if name.split("/")[0] == cable] for cable in pair]
    changed = dict(row)
    for first, second in zip(*names, strict=False):
        changed[first], changed[second] = row[second], row[first]
    return changed


def effort_ratios(model: Model, recorded: Recorded) -> dict[str, float]:
    """Median effort over that of the preload, by motor with one cable.

    Args:
        model: the robot.
        recorded: a motion with efforts of motors.
    """
    robot, columns = model.robot, channel_columns(model.layout)
    pose = Samples(np.zeros(1, np.int64), robot.reference_motors[None], robot.reference_pose[None])
    values = run(model, initial_state(model), pose)[1].values[0]
    wound = [name for cable in robot.cables for name in cable.motors]
    found = {}
    for name in (one for one in wound if wound.count(one) == 1):
        channel = f"{EFFORT}/{name}"
        expected = float(values[columns[channel]])
        if channel in recorded.references and expected != 0.0:
            found[name] = float(np.nanmedian(recorded.references[channel].value)) / expected
    return found
