"""What errors of encoders are worth in newtons."""

from __future__ import annotations

import numpy as np

from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.model_error import stiffness
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.description import Robot


def worth_of(robot: Robot) -> list[float]:
    """Change of the angle of every axis that alone makes a cable ``UNSURE`` [rad].

    A cable without preload counts with a tenth of its greatest tension.  Infinite where no cable
    acts on the axis.  Zero for a robot with joints without encoder, whose
    estimate does not follow from the angles alone.
    """
    if robot.unmeasured:
        return [0.0] * (len(robot.as_read.joints) + len(robot.motors))
    pose = np.array([joint.reference_angle for joint in robot.joints])
    shape = shape_at(prepare(robot, check_range=False), pose)
    usual = [cable.preload or 0.1 * cable.maximum_tension for cable in robot.cables]
    share = stiffness(robot, shape) / np.array(usual)[:, None]
    most = share.max(axis=0, initial=0.0)
    return [UNSURE_SHARE / one if one > 0.0 else np.inf for one in most.tolist()]
