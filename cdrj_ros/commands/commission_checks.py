"""Measurements that contradict each other in a way that names the mistake.

A fit would put such a mistake into numbers of the robot: efforts of the wrong sign, or readings of
a spring scale that were noted for each other's cables.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import combinations
from math import log
from typing import Final

import numpy as np

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.model.packing import EFFORT, channel_columns
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.groups import motors_of

OPPOSITE: Final = -1.0 / 3.0
"""Ratio of efforts below which their sign is wrong: that of a cable never changes."""

APART: Final = 0.08
"""Logarithm of the ratio of efforts from which a reading is suspected."""

ALIKE: Final = 0.05
"""The same up to which a reading of another cable fits: a drum errs by 3 %, a scale by 1 %."""


def refuse_signs(model: Model, recorded: Recorded) -> None:
    """Refuse efforts that push the cables.

    Args:
        model: the robot, with its preloads as they were read.
        recorded: a motion with efforts of motors.

    Raises:
        UsageError: names the motors and what to change.
    """
    ratios = effort_ratios(model, recorded)
    signs = {motor.name: motor.effort_sign for motor in model.robot.motors}
    wrong = [name for name, ratio in ratios.items() if ratio < OPPOSITE]
    if wrong:
        fits = ", ".join(f"motors.{name}.effort_sign: {-signs[name]:+d}" for name in wrong)
        raise UsageError(f"{recorded.name}: efforts are opposite to the cables' pull; {fits} fits")


def swapped(model: Model, recorded: Recorded, read: Collection[str]) -> tuple[str, str] | None:
    """Two cables whose readings on a spring scale fit the efforts only the other way round.

    Args:
        model: the robot, with its preloads as they were read.
        recorded: a motion with efforts of motors.
        read: names of the cables that were read.
    """
    preload = {cable.name: cable.preload for cable in model.robot.cables}
    cables = _single_cables(model)
    off = {
        cables[name]: log(ratio)
        for name, ratio in effort_ratios(model, recorded).items()
        if ratio > 0.0 and cables[name] in read
    }
    for one, other in combinations(off, 2):
        step = log(preload[other] / preload[one])
        before = min(abs(off[one]), abs(off[other]))
        after = max(abs(off[one] - step), abs(off[other] + step))
        if before > APART and after < ALIKE:
            return one, other
    return None


def effort_ratios(model: Model, recorded: Recorded) -> dict[str, float]:
    """Median effort over that of the preload, by motor with one cable.

    Args:
        model: the robot.
        recorded: a motion with efforts of motors.
    """
    robot, columns = model.robot, channel_columns(model.layout)
    pose = Samples(np.zeros(1, np.int64), robot.reference_motors[None], robot.reference_pose[None])
    values = run(model, initial_state(model), pose)[1].values[0]
    found = {}
    for name in _single_cables(model):
        channel = f"{EFFORT}/{name}"
        expected = float(values[columns[channel]])
        if channel in recorded.references and expected != 0.0:
            found[name] = float(np.nanmedian(recorded.references[channel].value)) / expected
    return found


def _single_cables(model: Model) -> Mapping[str, str]:
    """The cable of every motor that winds one."""
    found: dict[str, list[str]] = {}
    for cable in model.robot.cables:
        for motor in motors_of(cable):
            found.setdefault(motor, []).append(cable.name)
    return {motor: names[0] for motor, names in found.items() if len(names) == 1}
