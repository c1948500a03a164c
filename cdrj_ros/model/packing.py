"""Where everything lies in the flat arrays of a prepared robot, its state and its estimate.

The robot is prepared once (``cdrj_ros.model.prepared``) as ``plan`` (integers) and ``numbers``
(reals).  The header of ``plan`` says where each block lies.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cable import ELEMENT_COLUMNS, WORK_COLUMNS
from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.drum import MEMORY_SIZE
from cdrj_ros.model.geometry import POSE_NUMBERS

Indices = NDArray[np.int64]


# Header of ``plan``: sizes, then where each block begins in ``plan`` (AT_*) or ``numbers`` (IN_*).
(
    MOTORS,
    JOINTS,
    CABLES,
    ELEMENTS,
    PULLEYS,
    FRAMES,
    TERMS,
    AT_CABLES,
    AT_PULLEYS,
    AT_FRAMES,
    AT_NODES,
    AT_TERMS,
    IN_CABLES,
    IN_PULLEYS,
    IN_SPANS,
    IN_MATERIAL,
    IN_WRAPS,
    IN_LOSSES,
    IN_HALVES,
    IN_FRAMES,
    IN_NODES,
    IN_MOTORS,
    IN_JOINTS,
    IN_AXES,
    IN_TABLES,
    HEADER,
) = range(26)

# Integer columns of a cable; first_motor and last_motor are -1 where the end is an anchor.
(
    FIRST_ELEMENT,
    ELEMENT_COUNT,
    FIRST_MOTOR,
    LAST_MOTOR,
    LAW,
    STRIBECK,
    ROUTED,
    CABLE_INDICES,
) = range(8)

# Real columns of a cable.
(
    AXIAL_STIFFNESS,
    PRELOAD,
    MAXIMUM_TENSION,
    FIRST_RADIUS,
    FIRST_WINDING,
    LAST_RADIUS,
    LAST_WINDING,
    WOUND_TENSION,
    SLACK_TENSION,
    CABLE_NUMBERS,
) = range(10)

# A term adds a tabulated function of one joint to a span or a wrap.
TARGET, TARGET_INDEX, TERM_JOINT, TERM_TABLE, TERM_COLUMNS = range(5)
SPAN, WRAP = 0, 1

# Rows of motors and joints.
MOTOR_REFERENCE, MOTOR_COLUMNS = range(2)
TABLE_LOW, TABLE_STEP, JOINT_COLUMNS = range(3)

# Rows of axes: all motors, then all joints.
(
    EFFORT_SIGN,
    BEARING_TORQUE,
    BEARING_STIFFNESS,
    SPRING_STIFFNESS,
    SPRING_REST,
    AXIS_COLUMNS,
) = range(6)

STARTED: Final = 0
"""Place of the flag in the state that says whether a first sample has been seen."""


@compiled
def state_size(plan: Indices) -> int:
    """Floats of the state.

    In this order: the flag ``STARTED``, length and material of every element, bristle force, slip
    speed and lagged slip speed of every pulley, angle and bearing friction of every axis, the
    drums of both ends of every cable.
    """
    return (
        1
        + 2 * plan[ELEMENTS]
        + 3 * plan[PULLEYS]
        + 2 * (plan[MOTORS] + plan[JOINTS])
        + 2 * plan[CABLES] * MEMORY_SIZE
    )


@compiled
def estimate_size(plan: Indices) -> int:
    """Floats of the estimate, in the order of ``cdrj_ros.model.prepared.Layout``."""
    return 2 * plan[ELEMENTS] + 5 * plan[PULLEYS] + plan[MOTORS] + plan[JOINTS] + 2 * plan[CABLES]


@compiled
def scratch_size(plan: Indices) -> int:
    """Floats of the scratch space behind state and estimate."""
    elements, pulleys, joints = plan[ELEMENTS], plan[PULLEYS], plan[JOINTS]
    return (
        elements * (joints + 2 + ELEMENT_COLUMNS)
        + pulleys * (1 + WORK_COLUMNS)
        + plan[FRAMES] * (POSE_NUMBERS + 3 * joints)
    )
