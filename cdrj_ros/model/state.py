"""Named views of state, estimate and scratch, which one sample reads and writes.

``advance`` writes one vector: the new state, the estimate, then its scratch.  Only this file
defines their layout.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cable_records import CONTACT, SEGMENT, Contact, Segment
from cdrj_ros.model.drum import DRUM, Drum
from cdrj_ros.model.geometry import ARC_MIDDLE, POSE, TOUCH, TWIST, ArcMiddle, Pose, Touch, Twist
from cdrj_ros.model.packing import Sizes
from cdrj_ros.model.parts import grid, part, rows, table
from cdrj_ros.model.records import Grid, Rows, words

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

_DRUM, _SEGMENT, _CONTACT = words(DRUM), words(SEGMENT), words(CONTACT)
_POSE, _TWIST, _TOUCH = words(POSE), words(TWIST), words(TOUCH)
_ARC_MIDDLE = words(ARC_MIDDLE)


class StateViews(NamedTuple):
    """State of a robot between two samples: views of a state, in its order."""

    started: Vector
    """0 before the first sample, then 1, shape (1,)."""
    length: Vector
    """Geometric length of every segment with its share of the arcs [m], shape (segments,)."""
    material: Vector
    """Unstretched length of every segment [m], shape (segments,)."""
    delayed: Vector
    """Delayed strain of every segment [-], (E24), shape (segments,)."""
    bristle: Vector
    """Bristle force of every contact [N], shape (contacts,)."""
    slip_speed: Vector
    """Slip of the cable against the body at every contact, towards the last node [m/s], (E25),
    shape (contacts,)."""
    lagged_speed: Vector
    """Delayed slip speed, on which static friction depends [m/s], (E10), shape (contacts,)."""
    place: Vector
    """Place of the middle of every contact along the cable's path on the body [m], (E26), shape
    (contacts,)."""
    track: Vector
    """Place of the middle of every pulley's arc on that path [m], shape (pulleys,)."""
    covered: Vector
    """Length of cable on every pulley whose contact cells are fixed to its surface [m], shape
    (surfaces,); see ``PulleyPlan.surface``."""
    angle: Vector
    """Angles of motors, then joints [rad] or [m], shape (axes,)."""
    bearing_friction: Vector
    """Friction torques of motors, then joints [N m], of prismatic joints [N], shape (axes,)."""
    drums: Rows[Drum]
    """Of every end that takes up cable, shape (drums,); see ``EndPlan.drum``."""
    middles: Rows[ArcMiddle]
    """Of every node, shape (nodes,)."""


class EstimateViews(NamedTuple):
    """Results of a sample: views of an estimate, in its order."""

    tension: Vector
    """[N], shape (elements,)."""
    status: Vector
    """Bit flags, see ``cdrj_ros.model.status``, shape (elements,)."""
    force_x: Vector
    """Force of the cable on every pulley [N], shape (pulleys,)."""
    force_y: Vector
    """[N], shape (pulleys,)."""
    force_z: Vector
    """[N], shape (pulleys,)."""
    magnitude: Vector
    """Of the force on every pulley [N], (38), shape (pulleys,)."""
    friction: Vector
    """Tension after less tension before every pulley [N], shape (pulleys,)."""
    slip_speed: Vector
    """[m/s], positive towards the last node, shape (pulleys,)."""
    motor_effort: Vector
    """[N m], shape (motors,)."""
    joint_effort: Vector
    """[N m], of prismatic joints [N], shape (joints,)."""
    iterations: Vector
    """Newton iterations of every cable, shape (cables,)."""
    residual: Vector
    """Largest force imbalance at a pulley of every cable [N], shape (cables,)."""


class ScratchViews(NamedTuple):
    """Intermediate values of a sample: views of the scratch, in its order."""

    element_length: Vector
    """Geometric length of every element with its share of the arcs [m], shape (elements,)."""
    lever_arm: Table
    """Of every element about every joint [m], (E27), shape (elements, joints)."""
    direction: Table
    """Unit vectors of routed elements in the base frame, shape (elements, 3)."""
    wrap: Vector
    """Of every pulley [rad], shape (pulleys,)."""
    arc: Vector
    """Length of cable on every pulley [m], shape (pulleys,)."""
    laid: Vector
    """Cable that a turn of its frame or of its tangent has laid onto every end since the reference
    pose [m], shape (2 cables,)."""
    middle: Vector
    """Place of the middle of every arc along its body [m], up to a constant and whole turns, shape
    (pulleys,); only where it is given by tables."""
    segments: Rows[Segment]
    contacts: Rows[Contact]
    """Of every pulley, shape (pulleys,)."""
    pose: Rows[Pose]
    """Of every frame, shape (frames,)."""
    twist: Grid[Twist]
    """Of every frame by every joint, shape (frames, joints)."""
    touches: Rows[Touch]
    """Of every node, shape (nodes,)."""
    middles: Rows[ArcMiddle]
    """Of the same nodes."""
    history: Vector
    """The state before the sample, by the contact cells of this sample, shape (state_size,); empty
    unless some of them are fixed to the surface of a body."""


def _state_ends(
    sizes: Sizes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Where each part of a state ends, in the order of ``StateViews`` after ``started``."""
    segments = sizes.contacts + sizes.cables
    length = 1 + segments
    material = length + segments
    delayed = material + segments
    bristle = delayed + sizes.contacts
    slip_speed = bristle + sizes.contacts
    lagged_speed = slip_speed + sizes.contacts
    place = lagged_speed + sizes.contacts
    track = place + sizes.pulleys
    covered = track + sizes.surfaces
    angle = covered + sizes.motors + sizes.joints
    bearing_friction = angle + sizes.motors + sizes.joints
    drums = bearing_friction + sizes.drums * _DRUM
    middles = drums + sizes.nodes * _ARC_MIDDLE
    return (
        length, material, delayed, bristle, slip_speed, lagged_speed, place, track, covered,
        angle, bearing_friction, drums, middles,
    )  # fmt: skip


def state_size(sizes: Sizes) -> int:
    """Floats of the state."""
    return _state_ends(sizes)[12]


def state_views(sizes: Sizes, state: Vector) -> StateViews:
    """Named views of the parts of a state.

    Args:
        sizes: of the robot.
        state: shape (state_size,) or longer; in Python also (states, state_size), and the views
            then have the same first axis.
    """
    (
        length, material, delayed, bristle, slip_speed, lagged_speed, place, track, covered,
        angle, bearing_friction, drums, middles,
    ) = _state_ends(sizes)  # fmt: skip
    return StateViews(
        part(state, 0, 1),
        part(state, 1, length),
        part(state, length, material),
        part(state, material, delayed),
        part(state, delayed, bristle),
        part(state, bristle, slip_speed),
        part(state, slip_speed, lagged_speed),
        part(state, lagged_speed, place),
        part(state, place, track),
        part(state, track, covered),
        part(state, covered, angle),
        part(state, angle, bearing_friction),
        rows(state, bearing_friction, drums, DRUM),
        rows(state, drums, middles, ARC_MIDDLE),
    )


def estimate_size(sizes: Sizes) -> int:
    """Floats of the estimate."""
    per_axis = sizes.motors + sizes.joints
    return 2 * sizes.elements + 6 * sizes.pulleys + per_axis + 2 * sizes.cables


def estimate_views(sizes: Sizes, estimate: Vector) -> EstimateViews:
    """Named views of the parts of an estimate, shape (estimate_size,) or longer."""
    status = 2 * sizes.elements
    force_x = status + sizes.pulleys
    force_y = force_x + sizes.pulleys
    force_z = force_y + sizes.pulleys
    magnitude = force_z + sizes.pulleys
    friction = magnitude + sizes.pulleys
    slip_speed = friction + sizes.pulleys
    motor_effort = slip_speed + sizes.motors
    joint_effort = motor_effort + sizes.joints
    iterations = joint_effort + sizes.cables
    return EstimateViews(
        part(estimate, 0, sizes.elements),
        part(estimate, sizes.elements, status),
        part(estimate, status, force_x),
        part(estimate, force_x, force_y),
        part(estimate, force_y, force_z),
        part(estimate, force_z, magnitude),
        part(estimate, magnitude, friction),
        part(estimate, friction, slip_speed),
        part(estimate, slip_speed, motor_effort),
        part(estimate, motor_effort, joint_effort),
        part(estimate, joint_effort, iterations),
        part(estimate, iterations, estimate_size(sizes)),
    )


def _scratch_ends(
    sizes: Sizes,
) -> tuple[int, int, int, int, int, int, int, int, int, int, int, int, int, int]:
    """Where each part of the scratch ends, in the order of ``ScratchViews``."""
    element_length = sizes.elements
    lever_arm = element_length + sizes.elements * sizes.joints
    direction = lever_arm + 3 * sizes.elements
    wrap = direction + sizes.pulleys
    arc = wrap + sizes.pulleys
    laid = arc + 2 * sizes.cables
    middle = laid + sizes.pulleys
    segments = middle + (sizes.contacts + sizes.cables) * _SEGMENT
    contacts = segments + sizes.contacts * _CONTACT
    pose = contacts + sizes.frames * _POSE
    twist = pose + sizes.frames * sizes.joints * _TWIST
    touches = twist + sizes.nodes * _TOUCH
    middles = touches + sizes.nodes * _ARC_MIDDLE
    history = middles + (state_size(sizes) if sizes.surfaces > 0 else 0)
    return (
        element_length, lever_arm, direction, wrap, arc, laid, middle, segments, contacts,
        pose, twist, touches, middles, history,
    )  # fmt: skip


def scratch_size(sizes: Sizes) -> int:
    """Floats of the scratch."""
    return _scratch_ends(sizes)[13]


def scratch_views(sizes: Sizes, scratch: Vector) -> ScratchViews:
    """Named views of the parts of the scratch, shape (scratch_size,)."""
    (
        element_length, lever_arm, direction, wrap, arc, laid, middle, segments, contacts,
        pose, twist, touches, middles, history,
    ) = _scratch_ends(sizes)  # fmt: skip
    return ScratchViews(
        part(scratch, 0, element_length),
        table(scratch, element_length, sizes.elements, sizes.joints),
        table(scratch, lever_arm, sizes.elements, 3),
        part(scratch, direction, wrap),
        part(scratch, wrap, arc),
        part(scratch, arc, laid),
        part(scratch, laid, middle),
        rows(scratch, middle, segments, SEGMENT),
        rows(scratch, segments, contacts, CONTACT),
        rows(scratch, contacts, pose, POSE),
        grid(scratch, pose, sizes.frames, sizes.joints, TWIST),
        rows(scratch, twist, touches, TOUCH),
        rows(scratch, touches, middles, ARC_MIDDLE),
        part(scratch, middles, history),
    )
