"""Points of contact of one cable in space; see docs/geometry.md, section 3.

The points of contact of neighbouring round bodies depend on each other.  Sweeps along the cable
recompute each node from the points of its neighbours until no point moves any more.  A point that
moves along a tangent does not move the tangent, so two circles in a plane converge quadratically.
The result depends on the pose alone, not on the samples before it.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.records import Rows
from cdrj_ros.model.spatial_contacts import Z, meet
from cdrj_ros.model.spatial_drums import departure
from cdrj_ros.model.spatial_records import (
    POINT,
    SHEATH,
    SpatialNodeNumbers,
    SpatialNodePlan,
    SpatialPose,
    Touch,
)
from cdrj_ros.model.spatial_vectors import load, minus, norm, plus, rotated, rotated_back, store

MOST_SWEEPS = 200
"""Largest number of sweeps for a path."""

SETTLED = 4e-15
"""Motion of the points of contact, relative to the size of the cable, at which sweeps stop."""

ACCEPTED = 1e-12
"""Largest such motion in the last sweep; with a larger one the path counts as impossible."""

# Typed numbers: for them numba compiles a function once, for literals once per value.
FIRST: Final[Any] = np.int64(0)
NEXT: Final[Any] = np.int64(1)
PREVIOUS: Final[Any] = np.int64(-1)


@stage
def place_nodes(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    poses: Rows[SpatialPose],
    touches: Rows[Touch],
) -> float:
    """Place all nodes in the base, with contact at the centres; returns the cable's size [m]."""
    size = 0.0
    for k in range(len(nodes)):
        node, touch, pose = nodes[k], touches[k], poses[plans[k].frame]
        centre = plus(load(pose.origin), rotated(pose.rotation, load(node.centre)))
        store(touch.centre, centre)
        store(touch.entry, centre)
        store(touch.exit, centre)
        touch.touching, touch.angle, touch.wrap, touch.arc = 1.0, 0.0, 0.0, 0.0
        touch.share = 0.0
        store(touch.normal, Z)
        if plans[k].kind == SHEATH:
            far = poses[plans[k].exit_frame]
            store(touch.exit, plus(load(far.origin), rotated(far.rotation, load(node.exit))))
            touch.arc = node.length
        elif plans[k].kind != POINT:
            for i in range(3):
                row = (node.basis[3 * i], node.basis[3 * i + 1], node.basis[3 * i + 2])
                turned = rotated(pose.rotation, row)
                for j in range(3):
                    touch.basis[3 * i + j] = turned[j]
            if node.sided == 1.0:
                far = poses[plans[k].exit_frame]
                point = plus(load(far.origin), rotated(far.rotation, load(node.exit)))
                store(touch.side, rotated(touch.basis, minus(point, centre)))
        if k > 0:
            size += norm(minus(centre, load(touches[k - 1].centre))) + node.radius
    return size


@stage
def neighbour(touches: Rows[Touch], k: int, step: int) -> int:
    """Index of the next node that the cable touches, in the direction of ``step``."""
    k += step
    while touches[k].touching == 0.0:
        k += step
    return k


@stage
def _sweep(
    plans: Rows[SpatialNodePlan], nodes: Rows[SpatialNodeNumbers], touches: Rows[Touch]
) -> tuple[bool, float]:
    """Compute every contact once; returns whether all are possible and the largest motion [m]."""
    possible = True
    moved = 0.0
    last = len(nodes) - 1
    for k in range(last + 1):
        kind = plans[k].kind
        if kind in (POINT, SHEATH):
            continue
        touch = touches[k]
        centre = load(touch.centre)
        came = load(touches[neighbour(touches, k, PREVIOUS)].exit) if k > 0 else centre
        goes = load(touches[neighbour(touches, k, NEXT)].entry) if k < last else came
        if k == 0:
            came = goes
        store(touch.before, rotated(touch.basis, minus(came, centre)))
        store(touch.after, rotated(touch.basis, minus(goes, centre)))
        was = touch.touching
        fits, entry, leave = meet(nodes[k], kind, touch)
        if nodes[k].lead != 0.0:
            height = departure(nodes[k], touch, k == 0)
            entry, leave = plus(entry, (0.0, 0.0, height)), plus(leave, (0.0, 0.0, height))
        possible &= fits
        entry = plus(centre, rotated_back(touch.basis, entry))
        leave = plus(centre, rotated_back(touch.basis, leave))
        if touch.touching != was:
            moved = np.inf
        if touch.touching == 0.0:
            entry, leave = centre, centre
        moved = max(moved, norm(minus(entry, load(touch.entry))))
        moved = max(moved, norm(minus(leave, load(touch.exit))))
        store(touch.entry, entry)
        store(touch.exit, leave)
    return possible, moved


@stage
def find_path(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    touches: Rows[Touch],
    size: float,
) -> bool:
    """Find the points of contact of all nodes; False if a tangent does not exist."""
    coupled = False  # one sweep is exact if both neighbours of every round body are points
    for k in range(1, len(nodes)):
        coupled |= not (plans[k].kind in (POINT, SHEATH) or plans[k - 1].kind in (POINT, SHEATH))
    possible, moved = _sweep(plans, nodes, touches)
    if not coupled:
        return possible
    for _ in range(MOST_SWEEPS):
        if moved <= SETTLED * size:
            break
        possible, moved = _sweep(plans, nodes, touches)
    return possible and moved <= ACCEPTED * size
