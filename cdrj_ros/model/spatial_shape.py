"""Lengths, wraps and directions of the cables in space at given joint angles.

A kernel of its own, which robots without cables in space neither compile nor load: it takes twice
as long to compile as the geometry of all others.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import lean, stage
from cdrj_ros.model.linked import linked_lazily
from cdrj_ros.model.packing import SPATIAL, Indices, Numbers, Plan, number_views, plan_views
from cdrj_ros.model.spatial_frames import place_spatial_frames
from cdrj_ros.model.spatial_middle import clear_middle
from cdrj_ros.model.spatial_route import route_in_space
from cdrj_ros.model.state import ScratchViews, scratch_views

Vector = NDArray[np.float64]

SHAPE_SIGNATURE: Final = (
    "boolean(Array(int64, 1, 'C', True), Array(float64, 1, 'C', True), float64[::1], float64[::1],"
    " float64[::1])"
)
"""Types of ``shape`` and of ``shape_in_space``."""


@stage
def _wind_drums(
    plan: Plan, numbers: Numbers, c: int, motor_angle: Vector, scratch: ScratchViews
) -> None:
    """Set the angles of cable that the motors of one cable in space have wound in."""
    cable = plan.cables[c]
    for k in (0, 1):
        motor, drum = plan.ends[2 * c + k].motor, numbers.ends[2 * c + k]
        touch = scratch.touches[cable.first_node + k * cable.elements]
        touch.wound = 0.0
        if motor >= 0 and motor_angle.size > 0:
            reference = numbers.motors[motor].reference_angle
            touch.wound = drum.winding * (motor_angle[motor] - reference)


@lean
def shape_in_space(
    plan: Indices,
    numbers: Vector,
    motor_angle: Vector,
    joint_angle: Vector,
    scratch: Vector,
) -> bool:
    """The part of ``shape`` for frames and cables in space; what it writes for others stays.

    Args:
        plan, numbers, motor_angle, joint_angle: as ``shape``.
        scratch: shape (scratch_size,); the wraps of sheaths are given, poses of frames in space
            and what ``shape`` writes for their cables are written.

    Returns:
        False if the path of a cable in space is impossible.
    """
    parts = plan_views(plan)
    constants = number_views(parts.sizes, numbers)
    views = scratch_views(parts.sizes, scratch)
    place_spatial_frames(
        parts.spatial_frames,
        constants.spatial_frames,
        joint_angle,
        views.spatial_pose,
        views.spatial_twist,
    )
    possible = True
    for c in range(len(parts.cables)):
        cable = parts.cables[c]
        if cable.routed != SPATIAL:
            for k in range(cable.first_node, cable.first_node + cable.elements + 1):
                clear_middle(views.middles[k])
            continue
        first, last = cable.first_element, cable.first_element + cable.elements
        pulleys = slice(cable.first_pulley, cable.first_pulley + cable.pulleys)
        nodes = slice(cable.first_node, cable.first_node + cable.elements + 1)
        _wind_drums(parts, constants, c, motor_angle, views)
        possible &= route_in_space(
            parts.spatial_nodes[nodes],
            constants.spatial_nodes[nodes],
            views.spatial_pose,
            views.spatial_twist,
            joint_angle,
            views.touches[nodes],
            views.middles[nodes],
            views.element_length[first:last],
            views.lever_arm[first:last],
            views.wrap[pulleys],
            views.arc[pulleys],
            views.direction[first:last],
        )
    return possible


shape_in_space_linked: Final = linked_lazily(shape_in_space, SHAPE_SIGNATURE)
"""``shape_in_space``, to be called by kernels."""
