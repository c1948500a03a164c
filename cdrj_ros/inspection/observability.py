"""How well the efforts of the motors determine the joints without encoder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.robot.description import Winch

POSES: Final = 5
"""Poses along the range of each joint without encoder; the others stand at their reference."""

LEAST_SLOPE: Final = 1e-6
"""Singular value of the scaled slopes below which a direction is not determined."""


@dataclass(frozen=True)
class Determined:
    """One joint without encoder."""

    joint: str
    stddev: float
    """Largest standard deviation over the poses that follows from the noise of the efforts alone,
    while all cables pull [rad] or [m]; infinite where the efforts do not determine the angle."""


def determined_joints(model: Model) -> tuple[Determined, ...]:
    """How well each joint without encoder follows from the efforts, friction left aside.

    A change of a joint's angle stretches its cables, whose tension then turns the motors.  With
    cables that pull, this slope depends on lengths, EA and drums only.
    """
    robot = model.robot
    if not robot.unmeasured:
        return ()
    noise = np.array([motor.effort_noise for motor in robot.motors])
    reference = np.array([joint.reference_angle for joint in robot.joints])
    worst = np.zeros(len(robot.unmeasured))
    for k in robot.unmeasured:
        joint = robot.joints[k]
        for angle in np.linspace(joint.lower, joint.upper, POSES):
            pose = reference.copy()
            pose[k] = angle
            slopes = effort_slopes(model, pose)[:, robot.unmeasured] / noise[:, None]
            worst = np.maximum(worst, _stddevs(slopes))
    names = [robot.joints[j].name for j in robot.unmeasured]
    return tuple(Determined(n, float(w)) for n, w in zip(names, worst, strict=True))


def effort_slopes(model: Model, joint_angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of the motors' efforts by the joint angles with taut cables and no friction.

    Args:
        model: the prepared robot.
        joint_angle: the pose [rad] or [m], shape (joints,).

    Returns:
        [N m/rad] or [N m/m], shape (motors, joints).
    """
    robot = model.robot
    shape = shape_at(model, joint_angle)
    slopes = np.zeros((len(robot.motors), len(robot.joints)))
    names = [motor.name for motor in robot.motors]
    at = 0
    for cable in robot.cables:
        own = slice(at, at + len(cable.element_names))
        at = own.stop
        stiffness = cable.axial_stiffness / float(shape.length[own].sum())
        longer = shape.lever_arm[own].sum(axis=0)
        for node in (cable.nodes[0], cable.nodes[-1]):
            if isinstance(node, Winch):
                m = names.index(node.motor)
                sign = robot.motors[m].effort_sign
                slopes[m] -= sign * node.winding * node.radius * stiffness * longer
    return slopes


def _stddevs(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviations of the least-squares solution; infinite where it is not unique.

    Args:
        slopes: derivatives of the efforts, each divided by its standard deviation, (m, u).
    """
    size = np.sqrt((slopes**2).sum(axis=0))
    if not np.all(size > 0.0):
        return np.where(size > 0.0, 1.0 / np.maximum(size, 1e-300), np.inf)
    scaled = slopes / size
    _, values, directions = np.linalg.svd(scaled, full_matrices=True)
    found = np.zeros(size.size)
    for k in range(size.size):
        value = values[k] if k < values.size else 0.0
        part = directions[k] ** 2
        if value > LEAST_SLOPE:
            found += part / value**2
        else:
            found = np.where(part > LEAST_SLOPE, np.inf, found)
    return np.asarray(np.sqrt(found) / size)
