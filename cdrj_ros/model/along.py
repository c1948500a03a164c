"""Geometry of all cables along a motion of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.cells import follow_arc
from cdrj_ros.model.compiled import compiled, ordinary
from cdrj_ros.model.packing import Indices, number_views, plan_views
from cdrj_ros.model.prepared import Model, read_only
from cdrj_ros.model.shape import shape_linked
from cdrj_ros.model.state import scratch_size, scratch_views, state_size, state_views
from cdrj_ros.model.views import copy_part

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


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


@compiled
def _along(
    plan: Indices,
    numbers: Vector,
    joint_angle: Table,
    length: Table,
    lever_arm: NDArray[np.float64],
    wrap: Table,
    arc: Table,
    track: Table,
) -> int:
    """Write the geometry of many poses; returns the first impossible pose, or their number."""
    parts = plan_views(plan)
    constants = number_views(parts.sizes, numbers)
    size = state_size(parts.sizes)
    scratch, at_rest = np.empty(scratch_size(parts.sizes)), np.empty(0)
    states = np.zeros(2 * size)
    before, after = state_views(parts.sizes, states[:size]), state_views(parts.sizes, states[size:])
    found = scratch_views(parts.sizes, scratch)
    for k in range(joint_angle.shape[0]):
        if not shape_linked(plan, numbers, at_rest, joint_angle[k], scratch):
            return k
        for c in range(len(parts.cables)):
            for p in range(parts.cables[c].pulleys):
                follow_arc(parts, constants, c, p, before, after, found)
        for i in range(len(before.middles)):
            before.middles[i] = found.middles[i]
        copy_part(after.track, 0, before.track)
        copy_part(after.track, 0, track[k])
        copy_part(found.element_length, 0, length[k])
        copy_part(found.wrap, 0, wrap[k])
        copy_part(found.arc, 0, arc[k])
        for e in range(parts.sizes.elements):
            for j in range(parts.sizes.joints):
                lever_arm[k, e, j] = found.lever_arm[e, j]
    return joint_angle.shape[0]


def course(model: Model, joint_angle: Table) -> Course:
    """Geometry along a motion, with drums at rest.

    Args:
        model: the prepared robot.
        joint_angle: [rad] or [m], shape (n, joints).

    Raises:
        UsageError: the geometry is impossible in one of the poses.
    """
    n, sizes = joint_angle.shape[0], model.sizes
    length, lever_arm = np.empty((n, sizes.elements)), np.empty((n, sizes.elements, sizes.joints))
    wrap, arc, track = (np.empty((n, sizes.pulleys)) for _ in range(3))
    done = _along(
        model.plan, read_only(model.numbers), ordinary(joint_angle), length, lever_arm, wrap, arc,
        track,
    )  # fmt: skip
    if done < n:
        pose = ", ".join(
            f"{name} = {angle:.4g}"
            for name, angle in zip(model.layout.joints, joint_angle[done], strict=True)
        )
        raise UsageError(f"the path of a cable is impossible at {pose}")
    return Course(length, lever_arm, wrap, arc, track)
