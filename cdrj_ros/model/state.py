"""Named views of state and scratch, which one sample reads and writes, and the flags of a status.

``core/layout.hpp`` lays them out; ``Layout`` has the slices of an estimate.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import RECORDS, Part, Rows, Sizes, part, views

OK, SLACK, OVERLOAD, UNSURE, STALE, INVALID = 0, 1, 2, 4, 8, 16
"""Bit flags of an element's status; cdrj_msgs/CableTensions defines the same values."""


class StateViews(NamedTuple):
    """State of a robot between two samples: views of its first parts, in its order."""

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
    (surfaces,); see ``PulleyTopology.surface``."""
    angle: Vector
    """Angles of motors, then joints [rad] or [m], shape (axes,)."""
    bearing_friction: Vector
    """Friction torques of motors, then joints [N m], of prismatic joints [N], shape (axes,)."""
    drums: Rows
    """Of every end that takes up cable, shape (drums,); see ``EndTopology.drum``."""


class ScratchViews(NamedTuple):
    """Geometry of a sample: views of the first parts of the scratch, in its order."""

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
    segments: Rows
    contacts: Rows
    """Of every pulley, shape (pulleys,)."""
    pose: Rows
    """Of every frame, shape (frames,)."""
    twist: Rows
    """Of every frame by every joint, shape (frames, joints)."""
    touches: Rows
    """Of every node, shape (nodes,)."""


@lru_cache
def _state_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of a state, in the order of ``StateViews``."""
    segments, contacts = part(sizes.contacts + sizes.cables), part(sizes.contacts)
    axes = part(sizes.motors + sizes.joints)
    return (
        part(1),
        segments,
        segments,
        segments,
        contacts,
        contacts,
        contacts,
        contacts,
        part(sizes.pulleys),
        part(sizes.surfaces),
        axes,
        axes,
        part(sizes.drums, record=RECORDS["Drum"]),
    )


def state_views(sizes: Sizes, state: Vector) -> StateViews:
    """Named views of the parts of a state.

    Args:
        sizes: of the robot.
        state: shape (state_size,) or longer; in Python also (states, state_size), and the views
            then have the same first axis.
    """
    return StateViews(*views(state, _state_parts(sizes)))


@lru_cache
def _scratch_parts(sizes: Sizes) -> tuple[Part, ...]:
    """The parts of the scratch, in the order of ``ScratchViews``."""
    pulleys = part(sizes.pulleys)
    return (
        part(sizes.elements),
        part(sizes.elements, sizes.joints),
        part(sizes.elements, 3),
        pulleys,
        pulleys,
        part(2 * sizes.cables),
        pulleys,
        part(sizes.contacts + sizes.cables, record=RECORDS["Segment"]),
        part(sizes.contacts, record=RECORDS["Contact"]),
        part(sizes.frames, record=RECORDS["Pose"]),
        part(sizes.frames, sizes.joints, record=RECORDS["Twist"]),
        part(sizes.nodes, record=RECORDS["Touch"]),
    )


def scratch_views(sizes: Sizes, scratch: Vector) -> ScratchViews:
    """Named views of the parts of the scratch, shape (core.scratch_size,)."""
    return ScratchViews(*views(scratch, _scratch_parts(sizes)))
