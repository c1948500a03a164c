"""The law of one element: how its length, the points of contact and the middles of arcs move.

An element ends in the middle of the arcs beside it.  Per unit of joint j, dL_i = a_ij - dm_{i-1} +
dm_i: the lever arm, and cable that passes from one element to the next as the middle m of an arc
moves along its body.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model
from cdrj_ros.simulation.assembly import Course, course

STEP = 1e-6
"""Half of the interval of a central difference [rad] or [m]."""

Table = NDArray[np.float64]


def three_poses(model: Model, angle: Table, joint: int, step: float = STEP) -> Course:
    """The course of one joint through a pose, from a step before it to a step after it."""
    angles = np.tile(angle, (3, 1))
    angles[:, joint] += step * np.array([-1.0, 0.0, 1.0])
    return course(model, angles)


def touches_alike(found: Course) -> bool:
    """Whether the cables touch the same bodies in all poses: lift-off has no derivative."""
    return bool(np.all((found.wrap > 0.0) == (found.wrap[0] > 0.0)))


def differences(model: Model, found: Course, step: float = STEP) -> tuple[Table, Table]:
    """Derivative of every element's length as measured, and by the law, shapes (elements,).

    Args:
        model: the robot.
        found: from ``three_poses``, for one joint.
        step: as there.
    """
    measured = (found.length[2] - found.length[0]) / (2.0 * step)
    moved = (found.track[2] - found.track[0]) / (2.0 * step)
    law, element, pulley = np.zeros(measured.size), 0, 0
    for cable in model.robot.cables:
        count = len(cable.nodes) - 2
        middles = np.concatenate([[0.0], moved[pulley : pulley + count], [0.0]])
        law[element : element + count + 1] = np.diff(middles)
        element, pulley = element + count + 1, pulley + count
    return measured, law


def law_and_measured(
    model: Model, angle: Table, joint: int, step: float = STEP
) -> tuple[Table, Table] | None:
    """Both sides of the law for one joint, shapes (elements,); None at a lift-off."""
    found = three_poses(model, angle, joint, step)
    if not touches_alike(found):
        return None
    measured, passed = differences(model, found, step)
    return found.lever_arm[1, :, joint] + passed, measured
