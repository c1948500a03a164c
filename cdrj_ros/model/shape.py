"""Lengths, wraps and directions of all cables at given joint angles."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cells import divide_arcs
from cdrj_ros.model.compiled import lean, stage
from cdrj_ros.model.geometry import place_frames, route, table_value
from cdrj_ros.model.linked import linked
from cdrj_ros.model.packing import (
    PLANAR,
    SPATIAL,
    Indices,
    Numbers,
    Plan,
    number_views,
    plan_views,
)
from cdrj_ros.model.spatial_shape import SHAPE_SIGNATURE, shape_in_space_linked
from cdrj_ros.model.state import ScratchViews, scratch_views
from cdrj_ros.robot.description import TABLE_INTERVALS

Vector = NDArray[np.float64]


@stage
def _tabulated_shape(
    plan: Plan, numbers: Numbers, joint_angle: Vector, length: Vector, scratch: ScratchViews
) -> None:
    """Spans, wraps and lever arms from constants and tables over joint angle; no arcs yet."""
    wrap, lever_arm = scratch.wrap, scratch.lever_arm
    for e in range(len(numbers.elements)):
        length[e] = numbers.elements[e].span
    for p in range(len(numbers.pulleys)):
        wrap[p] = numbers.pulleys[p].wrap
    lever_arm[:] = 0.0
    for k in range(len(plan.terms)):
        term = plan.terms[k]
        joint, target = term.joint, term.target
        grid = numbers.joints[joint]
        position = (joint_angle[joint] - grid.lower) / grid.interval
        interval = min(max(int(position), 0), TABLE_INTERVALS - 1)
        cubic = numbers.tables[k * TABLE_INTERVALS + interval]
        value, slope = table_value(cubic, position - interval)
        if term.adds_to_wrap == 0:
            length[target] += value
            lever_arm[target, joint] += slope / grid.interval
        else:
            wrap[target] += value
            # cable is laid on from the element at the end of the arc that moves
            pulley, element = numbers.pulleys[target], plan.pulleys[target].element
            laid = pulley.radius * slope / grid.interval
            lever_arm[element, joint] += (0.5 - pulley.moved_after) * laid
            lever_arm[element + 1, joint] += (0.5 + pulley.moved_after) * laid


@stage
def _add_arcs(
    plan: Plan, numbers: Numbers, pulley: int, beyond: int, length: Vector, scratch: ScratchViews
) -> None:
    """Add the arcs on the pulleys of one cable given by spans to the lengths."""
    for p in range(pulley, beyond):
        arc = numbers.pulleys[p].radius * scratch.wrap[p]
        element = plan.pulleys[p].element
        length[element] += 0.5 * arc
        length[element + 1] += 0.5 * arc
        scratch.arc[p], scratch.middle[p] = arc, numbers.pulleys[p].moved_after * arc


@stage
def _place_cables(
    plan: Plan,
    numbers: Numbers,
    joint_angle: Vector,
    length: Vector,
    scratch: ScratchViews,
) -> bool:
    """The cables in the plane, with views; the others are placed afterwards."""
    possible = True
    _tabulated_shape(plan, numbers, joint_angle, length, scratch)
    place_frames(plan.frames, numbers.frames, joint_angle, scratch.pose, scratch.twist)
    for c in range(len(plan.cables)):
        cable = plan.cables[c]
        first, last = cable.first_element, cable.first_element + cable.elements
        pulley, beyond = cable.first_pulley, cable.first_pulley + cable.pulleys
        if cable.routed == PLANAR:
            nodes = slice(cable.first_node, cable.first_node + cable.elements + 1)
            possible &= route(
                plan.nodes[nodes],
                numbers.nodes[nodes],
                scratch.pose,
                scratch.twist,
                length[first:last],
                scratch.lever_arm[first:last],
                scratch.wrap[pulley:beyond],
                scratch.arc[pulley:beyond],
                scratch.middle[pulley:beyond],
                scratch.direction[first:last],
            )
        elif cable.routed != SPATIAL:
            _add_arcs(plan, numbers, pulley, beyond, length, scratch)
    return possible


@lean
def shape(
    plan: Indices,
    numbers: Vector,
    motor_angle: Vector,
    joint_angle: Vector,
    scratch: Vector,
) -> bool:
    """Geometry of all cables at the joint angles; False if the path of a cable is impossible.

    Args:
        plan, numbers: the prepared robot.
        motor_angle: [rad], shape (motors,), or (0,) for drums at rest.  Only drums with a pitch
            depend on it.
        joint_angle: [rad] or [m], shape (joints,).
        scratch: shape (scratch_size,); lengths of elements and segments, lever arms, wraps, arcs,
            poses of frames and, for routed elements only, directions are written.
    """
    parts = plan_views(plan)
    constants = number_views(parts.sizes, numbers)
    views = scratch_views(parts.sizes, scratch)
    possible = _place_cables(parts, constants, joint_angle, views.element_length, views)
    if len(parts.spatial_frames) > 0:
        possible &= shape_in_space_linked(plan, numbers, motor_angle, joint_angle, scratch)
    divide_arcs(parts, views)
    return possible


shape_linked: Final = linked(shape, SHAPE_SIGNATURE)
"""``shape``, to be called by kernels."""
