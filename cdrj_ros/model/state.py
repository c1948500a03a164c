"""Named views of state and scratch, which one sample reads and writes, and the flags of a status.

``core/layout.hpp`` lays them out and describes them; ``Layout`` has the slices of an estimate.
"""

from __future__ import annotations

from functools import lru_cache

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import Part, Sizes, Views, part, views

OK, SLACK, OVERLOAD, UNSURE, STALE, INVALID = 0, 1, 2, 4, 8, 16
"""Bit flags of an element's status; cdrj_msgs/CableTensions defines the same values."""


@lru_cache
def _state_parts(sizes: Sizes) -> dict[str, Part]:
    """The first parts of a state: ``State`` of the core."""
    segments, contacts = part(sizes.contacts + sizes.cables), part(sizes.contacts)
    axes = part(sizes.motors + sizes.joints)
    return {
        "started": part(1),
        "length": segments,
        "material": segments,
        "delayed": segments,
        "bristle": contacts,
        "slip_speed": contacts,
        "lagged_speed": contacts,
        "place": contacts,
        "track": part(sizes.pulleys),
        "covered": part(sizes.surfaces),
        "angle": axes,
        "bearing_friction": axes,
        "drums": part(sizes.drums, record="Drum"),
    }


def state_views(sizes: Sizes, state: Vector) -> Views:
    """Named views of the parts of a state.

    Args:
        sizes: of the robot.
        state: shape (state_size,) or longer; in Python also (states, state_size), and the views
            then have the same first axis.
    """
    return views(state, _state_parts(sizes))


@lru_cache
def _scratch_parts(sizes: Sizes) -> dict[str, Part]:
    """The first parts of the scratch: ``Workspace`` of the core."""
    pulleys = part(sizes.pulleys)
    return {
        "element_length": part(sizes.elements),
        "lever_arm": part(sizes.elements, sizes.joints),
        "direction": part(sizes.elements, 3),
        "wrap": pulleys,
        "arc": pulleys,
        "laid": part(2 * sizes.cables),
        "middle": pulleys,
        "segments": part(sizes.contacts + sizes.cables, record="Segment"),
        "contacts": part(sizes.contacts, record="Contact"),
        "pose": part(sizes.frames, record="Pose"),
        "twist": part(sizes.frames, sizes.joints, record="Twist"),
        "touches": part(sizes.nodes, record="Touch"),
    }


def scratch_views(sizes: Sizes, scratch: Vector) -> Views:
    """Named views of the parts of the scratch, shape (core.scratch_size,)."""
    return views(scratch, _scratch_parts(sizes))
