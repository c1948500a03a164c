"""Geometry of all cables along a motion of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Table
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model


@dataclass(frozen=True)
class Course:
    """Geometry over n poses, each of which follows from the one before by a small motion."""

    length: Table
    """Of every element with its share of the arcs [m], shape (n, elements)."""
    lever_arm: NDArray[np.float64]
    """Of every element about every joint [m], (E27), shape (n, elements, joints)."""
    wrap: Table
    """Of every pulley [rad], shape (n, pulleys)."""
    arc: Table
    """Length of cable on every pulley [m], shape (n, pulleys)."""
    track: Table
    """Place of the middle of every pulley's arc along its path on the body [m], up to a constant,
    (E26), shape (n, pulleys)."""


def course(model: Model, joint_angle: Table) -> Course:
    """Geometry along a motion, with drums at rest.

    Args:
        model: the prepared robot.
        joint_angle: [rad] or [m], shape (n, joints).

    Raises:
        UsageError: the geometry is impossible in one of the poses.
    """
    n, sizes = joint_angle.shape[0], model.sizes
    length, lever_arm = np.empty((n, sizes.elements)), np.empty((n, sizes.elements * sizes.joints))
    wrap, arc, track = (np.empty((n, sizes.pulleys)) for _ in range(3))
    done = model.core.course(joint_angle, length, lever_arm, wrap, arc, track)
    if done < n:
        pose = ", ".join(
            f"{name} = {angle:.4g}"
            for name, angle in zip(model.layout.joints, joint_angle[done], strict=True)
        )
        raise UsageError(f"the path of a cable is impossible at {pose}")
    arms = lever_arm.reshape(n, sizes.elements, sizes.joints)
    return Course(length, arms, wrap, arc, track)
