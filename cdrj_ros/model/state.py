"""What one sample reads and writes: named views of state and scratch, and the parts of an estimate.

``core/layout.hpp`` lays them out and describes them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.packing import Part, Sizes, Views, part, views
from cdrj_ros.robot.description import Robot

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


TENSION: Final = "tension"
"""``tension/cable/element`` [N]."""

NODAL_FORCE: Final = "nodal_force"
"""``nodal_force/cable/node``, the magnitude [N]."""

EFFORT: Final = "effort"
"""``effort/motor`` or ``effort/joint`` [N m], [N] for a prismatic joint."""


@dataclass(frozen=True)
class Layout:
    """Slices of all results in the estimate, and the names of their entries."""

    elements: tuple[str, ...]
    """``cable/element``, the order of ``tension`` and ``status``."""
    pulleys: tuple[str, ...]
    """``cable/node``, the order of everything that belongs to pulleys."""
    base_link: str
    """Name in tf of the robot's base frame."""
    force_frame: str
    """Frame of forces: ``base_link``; empty where all forces are in the frames of their pulleys."""
    motors: tuple[str, ...]
    joints: tuple[str, ...]
    cables: tuple[str, ...]
    element_before: NDArray[np.intp] = field(compare=False, repr=False)
    """Index of the element before every pulley; the next index is the one after it.  Read-only."""
    size: int
    """Floats of one estimate."""
    tension: slice
    """[N]."""
    status: slice
    """Bit flags, see ``cdrj_ros.model.state``."""
    force_x: slice
    """[N], of the cable on the pulley."""
    force_y: slice
    """[N]."""
    force_z: slice
    """[N]; 0 for cables in a plane."""
    magnitude: slice
    """[N], eq. (38)."""
    friction: slice
    """t_i - t_{i-1} [N]."""
    slip_speed: slice
    """[m/s], positive towards the last node."""
    motor_effort: slice
    """[N m]."""
    joint_effort: slice
    """[N m], of a prismatic joint [N]."""
    iterations: slice
    """Newton iterations of every cable."""
    residual: slice
    """Largest force imbalance at a pulley of every cable [N]."""
    correction: slice
    """Learned correction that is part of an output [N] or [N m]."""
    trust: slice
    """Share of it that applies."""

    def in_frame(self, base_link: str) -> Layout:
        """The layout with another name of the base frame; empty: this one."""
        base = base_link or self.base_link
        return replace(self, base_link=base, force_frame=base if self.force_frame else "")

    def pulley_status(self, status: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Flags of pulleys, shape (..., pulleys): the union of those of both adjacent elements.

        Args:
            status: flags of the elements, shape (..., elements).
        """
        before = self.element_before
        return status[..., before] | status[..., before + 1]


def layout_of(robot: Robot, rows: Any, sizes: Sizes) -> Layout:
    """Layout of the estimate, whose parts have the order of ``Estimate`` in ``core/layout.hpp``."""
    elements = tuple(name for cable in robot.cables for name in cable.element_names)
    pulleys = tuple(name for cable in robot.cables for name in cable.pulley_names)
    counts = [*2 * [sizes.elements], *6 * [sizes.pulleys], sizes.motors, sizes.joints]
    counts += [*2 * [sizes.cables], *2 * [sizes.residuals]]
    ends = np.cumsum([0, *counts]).tolist()
    slices = [slice(a, b) for a, b in pairwise(ends)]
    before = rows["element"].astype(np.intp)
    before.flags.writeable = False
    placed = any(cable.placed for cable in robot.cables)
    return Layout(
        elements,
        pulleys,
        robot.base_link,
        robot.base_link if placed else "",
        tuple(motor.name for motor in robot.motors),
        tuple(joint.name for joint in robot.joints),
        tuple(cable.name for cable in robot.cables),
        before,
        ends[-1],
        *slices,
    )


def channel_columns(layout: Layout) -> dict[str, int]:
    """Columns of tensions, nodal forces, motor and joint efforts in an estimate, by channel."""
    named: dict[str, int] = {}
    for prefix, names, where in (
        (TENSION, layout.elements, layout.tension),
        (NODAL_FORCE, layout.pulleys, layout.magnitude),
        (EFFORT, layout.motors, layout.motor_effort),
        (EFFORT, layout.joints, layout.joint_effort),
    ):
        named |= {f"{prefix}/{name}": where.start + k for k, name in enumerate(names)}
    return named
