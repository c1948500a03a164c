"""Geometry of all cables at given joint angles: lengths, wraps, directions, one after another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cable import PULLEY_COLUMNS, RADIUS
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.geometry import (
    FRAME_INDICES,
    FRAME_NUMBERS,
    NODE_INDICES,
    NODE_NUMBERS,
    place_frames,
    route,
    table_value,
)
from cdrj_ros.model.packing import (
    AT_CABLES,
    AT_FRAMES,
    AT_NODES,
    AT_PULLEYS,
    AT_TERMS,
    CABLE_INDICES,
    CABLES,
    ELEMENT_COUNT,
    ELEMENTS,
    FIRST_ELEMENT,
    FRAMES,
    IN_FRAMES,
    IN_JOINTS,
    IN_NODES,
    IN_PULLEYS,
    IN_SPANS,
    IN_TABLES,
    IN_WRAPS,
    JOINT_COLUMNS,
    PULLEYS,
    ROUTED,
    SPAN,
    TABLE_LOW,
    TABLE_STEP,
    TARGET,
    TARGET_INDEX,
    TERM_COLUMNS,
    TERM_JOINT,
    TERM_TABLE,
    TERMS,
)
from cdrj_ros.robot.description import TABLE_INTERVALS

Vector = NDArray[np.float64]
Table = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def _tabulated_shape(
    plan: Indices,
    numbers: Vector,
    joint_angle: Vector,
    length: Vector,
    length_by_joint: Table,
    wrap: Vector,
) -> None:
    """Spans and wraps from constants and tables over joint angle, arcs not yet added."""
    elements, pulleys = plan[ELEMENTS], plan[PULLEYS]
    at = plan[IN_SPANS]
    for e in range(elements):
        length[e] = numbers[at + e]
    at = plan[IN_WRAPS]
    for p in range(pulleys):
        wrap[p] = numbers[at + p]
    length_by_joint[:] = 0.0
    for term in range(plan[TERMS]):
        row = plan[AT_TERMS] + term * TERM_COLUMNS
        joint = plan[row + TERM_JOINT]
        grid = plan[IN_JOINTS] + joint * JOINT_COLUMNS
        step = numbers[grid + TABLE_STEP]
        position = (joint_angle[joint] - numbers[grid + TABLE_LOW]) / step
        interval = min(max(int(position), 0), TABLE_INTERVALS - 1)
        base = plan[IN_TABLES] + (plan[row + TERM_TABLE] * TABLE_INTERVALS + interval) * 4
        value, slope = table_value(numbers, base, position - interval)
        target = plan[row + TARGET_INDEX]
        if plan[row + TARGET] == SPAN:
            length[target] += value
            length_by_joint[target, joint] += slope / step
        else:
            # half of the arc belongs to either neighbour; pulley p of cable c lies between
            # elements p + c and p + c + 1, which the plan stores as the pulley's element
            wrap[target] += value
            radius = numbers[plan[IN_PULLEYS] + target * PULLEY_COLUMNS + RADIUS]
            half = 0.5 * radius * slope / step
            element = plan[plan[AT_PULLEYS] + target * 2]
            length_by_joint[element, joint] += half
            length_by_joint[element + 1, joint] += half


@compiled
def shape(
    plan: Indices,
    numbers: Vector,
    joint_angle: Vector,
    length: Vector,
    length_by_joint: Table,
    wrap: Vector,
    direction: Table,
    pose: Table,
    twist: NDArray[np.float64],
) -> bool:
    """Geometry of all cables at the joint angles; False where a cable cannot run so.

    Args:
        plan, numbers: the prepared robot.
        joint_angle: [rad] or [m], shape (joints,).
        length: of every element, arcs included [m], shape (elements,), written.
        length_by_joint: its derivatives, shape (elements, joints), written.
        wrap: of every pulley [rad], shape (pulleys,), written.
        direction: unit vectors of routed elements in the base frame, shape (elements, 2), written.
        pose, twist: frames, see ``place_frames``, written.
    """
    possible = True
    cables = plan[CABLES]
    _tabulated_shape(plan, numbers, joint_angle, length, length_by_joint, wrap)
    frames = plan[FRAMES]
    if frames > 0:
        at, inside = plan[AT_FRAMES], plan[IN_FRAMES]
        place_frames(
            plan[at : at + frames * FRAME_INDICES].reshape(frames, FRAME_INDICES),
            numbers[inside : inside + frames * FRAME_NUMBERS].reshape(frames, FRAME_NUMBERS),
            joint_angle,
            pose,
            twist,
        )
    node = 0
    for c in range(cables):
        row = plan[AT_CABLES] + c * CABLE_INDICES
        first = plan[row + FIRST_ELEMENT]
        count = plan[row + ELEMENT_COUNT]
        pulley = first - c
        if plan[row + ROUTED] == 1:
            at = plan[AT_NODES] + node * NODE_INDICES
            inside = plan[IN_NODES] + node * NODE_NUMBERS
            nodes = count + 1
            possible &= route(
                plan[at : at + nodes * NODE_INDICES].reshape(nodes, NODE_INDICES),
                numbers[inside : inside + nodes * NODE_NUMBERS].reshape(nodes, NODE_NUMBERS),
                pose,
                twist,
                length[first : first + count],
                length_by_joint[first : first + count],
                wrap[pulley : pulley + count - 1],
                direction[first : first + count],
            )
        else:
            for p in range(count - 1):
                radius = numbers[plan[IN_PULLEYS] + (pulley + p) * PULLEY_COLUMNS + RADIUS]
                half = 0.5 * radius * wrap[pulley + p]
                length[first + p] += half
                length[first + p + 1] += half
        node += count + 1
    return possible
