"""What errors of encoders are worth in newtons, and which ones no reading shows."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.model_error import stiffness
from cdrj_ros.estimation.reading_limits import half_width
from cdrj_ros.foundation.arrays import Table
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.description import Robot

LEAST_STEP: Final = 4.0
"""Smallest step that is found at any rate, by the greatest error of a reading, (C7)."""


class Slip(NamedTuple):
    """What a step of one encoder does before readings show it."""

    axis: str
    unseen: float
    """Steps up to this are not seen even at high rates and in slow motion [rad] or [m]."""
    tension: float
    """What such a step is worth in the tension of a cable [N]."""
    unsure: float
    """A step beyond this makes all elements ``UNSURE`` [rad] or [m]."""


def slips(model: Model) -> list[Slip]:
    """Of every motor and joint with an encoder on which a cable acts."""
    robot = model.robot
    most = _stiffness(model).max(axis=0, initial=0.0).tolist()
    unseen = [LEAST_STEP * half_width(axis.sensor) for axis in robot.axes]
    measured = {axis.name for axis in robot.as_read.axes}
    return [
        Slip(axis.name, step, step * newtons, unsure)
        for axis, step, newtons, unsure in zip(
            robot.axes, unseen, most, _worth(model), strict=True
        )
        if axis.name in measured and newtons > 0.0
    ]  # fmt: skip


def worth_of(robot: Robot) -> list[float]:
    """Change of the angle of every axis with an encoder that alone makes a cable ``UNSURE`` [rad].

    Zero for a robot with joints without encoder, whose estimate does not follow from the angles
    alone.
    """
    if robot.unmeasured:
        return [0.0] * len(robot.as_read.axes)
    return _worth(prepare(robot, check_range=False))


def _worth(model: Model) -> list[float]:
    """Change of the angle of every axis that changes a tension by a share of the preload [rad].

    A cable without preload counts with a tenth of its greatest tension.  Infinite where no cable
    acts on the axis.
    """
    usual = [cable.preload or 0.1 * cable.maximum_tension for cable in model.robot.cables]
    share = _stiffness(model) / np.array(usual)[:, None]
    most = share.max(axis=0, initial=0.0)
    return [UNSURE_SHARE / one if one > 0.0 else np.inf for one in most.tolist()]


def _stiffness(model: Model) -> Table:
    """See ``stiffness``, in the reference pose."""
    pose = np.array([joint.reference_angle for joint in model.robot.joints])
    return stiffness(model.robot, shape_at(model, pose))
