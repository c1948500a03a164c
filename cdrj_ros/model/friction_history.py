"""A friction history for a cable of which nobody knows how it got where it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cable import DRAG, LOSS, PULLEY_COLUMNS, WORK_COLUMNS
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.friction import NONE
from cdrj_ros.model.geometry import POSE_NUMBERS
from cdrj_ros.model.mechanism import friction_losses
from cdrj_ros.model.packing import (
    AT_CABLES,
    AXIAL_STIFFNESS,
    CABLE_INDICES,
    CABLE_NUMBERS,
    CABLES,
    ELEMENT_COUNT,
    ELEMENTS,
    FIRST_ELEMENT,
    FRAMES,
    IN_CABLES,
    IN_PULLEYS,
    JOINTS,
    LAW,
    PULLEYS,
)
from cdrj_ros.model.shape import shape

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def impose_friction(
    plan: Indices,
    numbers: Vector,
    joint_angle: Vector,
    share: Vector,
    state: Vector,
    scratch: Vector,
) -> None:
    """Give a cable that has just been started a friction history, its elongation kept.

    Args:
        plan, numbers: the prepared robot.
        joint_angle: [rad], shape (joints,).
        share: of every pulley's bound that its friction holds, in [-1, 1], positive where the
            tension rises towards the last node, shape (pulleys,).
        state: as ``advance`` has left it after a first sample, changed.
        scratch: shape (scratch_size,).
    """
    elements, pulleys, frames = plan[ELEMENTS], plan[PULLEYS], plan[FRAMES]
    joints = plan[JOINTS]
    n = 0
    length = scratch[n : n + elements]
    n += elements
    length_by_joint = scratch[n : n + elements * joints].reshape(elements, joints)
    n += elements * joints
    wrap = scratch[n : n + pulleys]
    n += pulleys
    work = scratch[n : n + pulleys * WORK_COLUMNS].reshape(pulleys, WORK_COLUMNS)
    n += pulleys * WORK_COLUMNS
    pose = scratch[n : n + frames * POSE_NUMBERS].reshape(frames, POSE_NUMBERS)
    n += frames * POSE_NUMBERS
    twist = scratch[n : n + frames * joints * 3].reshape(frames, joints, 3)
    n += frames * joints * 3
    direction = scratch[n : n + 2 * elements].reshape(elements, 2)
    if not shape(plan, numbers, joint_angle, length, length_by_joint, wrap, direction, pose, twist):
        return
    material = state[1 + elements : 1 + 2 * elements]
    bristle = state[1 + 2 * elements : 1 + 2 * elements + pulleys]
    lagged = state[1 + 2 * elements + 2 * pulleys : 1 + 2 * elements + 3 * pulleys]
    friction_losses(plan, numbers, wrap, lagged, work)
    for c in range(plan[CABLES]):
        row = plan[AT_CABLES] + c * CABLE_INDICES
        first = plan[row + FIRST_ELEMENT]
        last = first + plan[row + ELEMENT_COUNT]
        stiffness = numbers[plan[IN_CABLES] + c * CABLE_NUMBERS + AXIAL_STIFFNESS]
        if plan[row + LAW] == NONE:
            continue
        total = 0.0
        span = 0.0
        for e in range(first, last):
            total += material[e]
            span += length[e]
        mean = stiffness * (span / total - 1.0)
        if not mean > 0.0:
            continue
        # ratios of the tensions, then the one factor that keeps the elongation
        ratio = 1.0
        weighted = 0.0
        for e in range(first, last):
            if e > first:
                i = e - 1 - c
                drag = numbers[plan[IN_PULLEYS] + i * PULLEY_COLUMNS + DRAG]
                hold = max(1.0 - work[i, LOSS] - drag / (mean + drag), 1e-3)
                ratio *= hold ** (-share[i])
            scratch[e] = ratio  # the lengths are those of the state: their place is free
            weighted += state[1 + e] * ratio
        scale = mean * span / weighted
        for _ in range(3):
            held = 0.0
            slope = 0.0
            for e in range(first, last):
                stretch = 1.0 + scale * scratch[e] / stiffness
                held += state[1 + e] / stretch
                slope -= state[1 + e] * scratch[e] / (stiffness * stretch * stretch)
            scale -= (held - total) / slope
        for e in range(first, last):
            material[e] = state[1 + e] / (1.0 + scale * scratch[e] / stiffness)
            if e > first:
                bristle[e - 1 - c] = scale * (scratch[e] - scratch[e - 1])
