"""A prepared robot as two flat vectors, and named views of their parts.

``plan`` holds integers: the numbers of all parts and their connections.  ``numbers`` holds reals;
the members of an ensemble differ only in ``numbers`` and share one plan.  The compiled core reads
the same two vectors; ``plan_views`` and ``number_views`` return their named views in Python.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cable_records import PULLEY, PulleyNumbers
from cdrj_ros.model.geometry import (
    CUBIC,
    FRAME,
    FRAME_PLAN,
    NODE,
    NODE_PLAN,
    Cubic,
    FrameNumbers,
    FramePlan,
    NodeNumbers,
    NodePlan,
)
from cdrj_ros.model.records import Part, Rows, part, record_type, size_of, views
from cdrj_ros.robot.description import TABLE_INTERVALS

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]


class Sizes(NamedTuple):
    """Numbers of the parts of a robot; a plan begins with them."""

    motors: int
    joints: int
    cables: int
    elements: int
    pulleys: int
    contacts: int
    """Contact cells of all pulleys."""
    frames: int
    """0 for a robot without positions."""
    nodes: int
    """Of all cables; 0 for a robot without positions."""
    terms: int
    """Tabulated functions of a joint angle that are added to a span or a wrap."""
    drums: int
    """Ends of cables that take up cable: drums and sectors."""
    surfaces: int = 0
    """Pulleys whose contact cells are fixed to their surface; 0 but for the simulated rig."""


class CablePlan:
    """Parts of a cable; its elements, pulleys, contacts, segments and nodes are consecutive."""

    first_element: int
    elements: int
    first_pulley: int
    pulleys: int
    first_contact: int
    contacts: int
    """Of all its pulleys.  Contact k of the robot's cable c lies before segment k + c + 1."""
    first_node: int
    law: int
    """Code of the friction law of all its pulleys."""
    routed: int
    """1 where lengths and wraps follow from positions, 0 where tables give them."""


class EndPlan:
    """One end of a cable."""

    motor: int
    """Motor of its winch; -1 for an anchor."""
    drum: int
    """Its memory among those of the state; -1 for a point."""


class PulleyPlan:
    """Place of a pulley in its cable, its contact cells, and the form of its friction."""

    element: int
    """The element before it."""
    first_contact: int
    cells: int
    """Number of its contact cells."""
    surface: int
    """Its number among the pulleys whose cells are fixed to their surface; -1 where they are equal
    parts of the arc and move with it."""
    wrap_changes: int
    """0 where the wrap is the same in every pose."""
    stribeck: int
    """Code of the form of static friction."""


class TermPlan:
    """A tabulated function of one joint angle, added to a span or a wrap."""

    adds_to_wrap: int
    """1: ``target`` is a pulley, whose wrap it changes; 0: an element, whose span it changes."""
    target: int
    joint: int


class CableNumbers:
    """Constants of a cable."""

    axial_stiffness: float
    """EA [N]."""
    bedding_strain: float
    """Strain that the strands' bedding adds at high load [-], (E21); 0 for a linear cable."""
    bedding_tension: float
    """Tension at which half of it is taken up [N]."""
    creep_share: float
    """Delayed strain as a share of the elastic one [-], (E24); 0 for none."""
    creep_time: float
    """Its time constant [s]."""
    flow_time: float
    """Time in which the flow equals the elastic strain [s]; infinite for none."""
    preload: float
    """Tension in the reference pose [N]."""
    maximum_tension: float
    """An element with a higher tension is overloaded [N]."""
    wound_tension: float
    """Tension at which the cable was wound onto its drums [N]."""
    slack_tension: float
    """An element with this tension or a lower one is slack [N]."""


class EndNumbers:
    """Constants of one end of a cable; 0 for a point."""

    radius: float
    """Cable per radian on a drum or a sector [m/rad]."""
    winding: float
    """+1 where a positive motor angle winds cable in, -1 where it pays it out; 0 for sectors."""


class ElementNumbers:
    """Constants of an element."""

    span: float
    """Constant part of the length between tangent points [m]; 0 where it follows from positions."""


class SegmentNumbers:
    """Constants of a segment."""

    material: float
    """Unstretched length in the reference pose [m]."""


class MotorNumbers:
    """Constants of a motor."""

    reference_angle: float
    """Reading in the pose in which the preload was measured [rad]."""


class JointNumbers:
    """The grid of a joint's tables."""

    lower: float
    """Lower end of the joint's range [rad] or [m]."""
    interval: float
    """Width of an interval of the tables [rad] or [m]."""


class AxisNumbers:
    """Constants of the passive torque of a motor or joint, (E13); N for N m at prismatic joints."""

    effort_sign: float
    """+1 or -1, see ``cdrj_ros.robot.description.Motor``."""
    bearing_torque: float
    """Coulomb friction [N m]."""
    bearing_stiffness: float
    """Slope of the friction where the motion reverses [N m/rad]."""
    spring_stiffness: float
    """[N m/rad]."""
    spring_rest: float
    """Angle at which the spring's torque vanishes [rad]."""


CABLE_PLAN: Final = record_type(CablePlan)
END_PLAN: Final = record_type(EndPlan)
PULLEY_PLAN: Final = record_type(PulleyPlan)
TERM_PLAN: Final = record_type(TermPlan)
CABLE: Final = record_type(CableNumbers)
END: Final = record_type(EndNumbers)
ELEMENT: Final = record_type(ElementNumbers)
SEGMENT_NUMBERS: Final = record_type(SegmentNumbers)
MOTOR: Final = record_type(MotorNumbers)
JOINT: Final = record_type(JointNumbers)
AXIS: Final = record_type(AxisNumbers)

_SIZES: Final = len(Sizes._fields)


class Plan(NamedTuple):
    """Connections of a robot: views of ``plan``, in its order."""

    sizes: Sizes
    cables: Rows[CablePlan]
    ends: Rows[EndPlan]
    """Shape (2 cables,); cable c has its first end at 2 c and its last end at 2 c + 1."""
    pulleys: Rows[PulleyPlan]
    terms: Rows[TermPlan]
    frames: Rows[FramePlan]
    nodes: Rows[NodePlan]


class Numbers(NamedTuple):
    """Constants of a robot: views of ``numbers``, in its order."""

    cables: Rows[CableNumbers]
    ends: Rows[EndNumbers]
    """As in ``Plan``."""
    pulleys: Rows[PulleyNumbers]
    elements: Rows[ElementNumbers]
    segments: Rows[SegmentNumbers]
    motors: Rows[MotorNumbers]
    joints: Rows[JointNumbers]
    axes: Rows[AxisNumbers]
    """All motors, then all joints."""
    tables: Rows[Cubic]
    """``TABLE_INTERVALS`` cubics for every term, shape (terms * TABLE_INTERVALS,)."""
    frames: Rows[FrameNumbers]
    nodes: Rows[NodeNumbers]


@lru_cache
def _plan_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of a plan after its sizes, in the order of ``Plan``."""
    return (
        part(sizes.cables, record=CABLE_PLAN),
        part(2 * sizes.cables, record=END_PLAN),
        part(sizes.pulleys, record=PULLEY_PLAN),
        part(sizes.terms, record=TERM_PLAN),
        part(sizes.frames, record=FRAME_PLAN),
        part(sizes.nodes, record=NODE_PLAN),
    )


def plan_views(plan: Indices) -> Plan:
    """Named views of the parts of a plan."""
    sizes = Sizes(*plan[:_SIZES].tolist())
    return Plan(sizes, *views(plan, _plan_parts(sizes), _SIZES))


@lru_cache
def _number_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of the numbers, in the order of ``Numbers``."""
    return (
        part(sizes.cables, record=CABLE),
        part(2 * sizes.cables, record=END),
        part(sizes.pulleys, record=PULLEY),
        part(sizes.elements, record=ELEMENT),
        part(sizes.contacts + sizes.cables, record=SEGMENT_NUMBERS),
        part(sizes.motors, record=MOTOR),
        part(sizes.joints, record=JOINT),
        part(sizes.motors + sizes.joints, record=AXIS),
        part(sizes.terms * TABLE_INTERVALS, record=CUBIC),
        part(sizes.frames, record=FRAME),
        part(sizes.nodes, record=NODE),
    )


def number_views(sizes: Sizes, numbers: Vector) -> Numbers:
    """Named views of the parts of the numbers.

    Args:
        sizes: of the robot.
        numbers: shape (numbers,); in Python also (robots, numbers), and the views then have the
            same first axis.
    """
    return Numbers(*views(numbers, _number_parts(sizes)))


def empty_robot(sizes: Sizes) -> tuple[Indices, Vector]:
    """Plan and numbers of a robot, all zero except for the sizes."""
    plan = np.zeros(_SIZES + size_of(_plan_parts(sizes)), dtype=np.int64)
    plan[:_SIZES] = sizes
    return plan, np.zeros(size_of(_number_parts(sizes)))
