"""Lengths, wraps and directions of one cable in space from its points of contact."""

from __future__ import annotations

from math import atan2

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import stage
from cdrj_ros.model.records import Rows
from cdrj_ros.model.spatial_contacts import measure
from cdrj_ros.model.spatial_records import (
    POINT,
    SHEATH,
    SpatialNodeNumbers,
    SpatialNodePlan,
    Touch,
)
from cdrj_ros.model.spatial_sweeps import FIRST, NEXT, neighbour
from cdrj_ros.model.spatial_vectors import Vector3, cross, dot, load, minus, norm, scaled

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

LEAST_SHARE = 1e-3
"""Smallest distance of neighbouring nodes along a line that misses some, over its length [-]."""


@stage
def straight(touches: Rows[Touch], p: int, q: int) -> tuple[Vector3, float]:
    """Direction and length of the straight line from node p to node q."""
    way = minus(load(touches[q].entry), load(touches[p].exit))
    length = norm(way)
    return scaled(1.0 / length, way), length


@stage
def _share_line(touches: Rows[Touch], p: int, q: int) -> None:
    """Set positions along the line from p to q of the nodes between, which it misses: (G9)."""
    begin = load(touches[p].exit)
    way = minus(load(touches[q].entry), begin)
    least = 0.0
    for k in range(p + 1, q):
        share = dot(minus(load(touches[k].centre), begin), way) / dot(way, way)
        most = 1.0 - (q - k) * LEAST_SHARE
        least += LEAST_SHARE
        touches[k].share = min(max(share, least), most)
        least = touches[k].share


@stage
def measure_cable(
    plans: Rows[SpatialNodePlan],
    nodes: Rows[SpatialNodeNumbers],
    touches: Rows[Touch],
    length: Vector,
    wrap: Vector,
    direction: Table,
) -> bool:
    """Compute lengths without the arcs of ends, wraps and directions; False if impossible."""
    possible = True
    last = len(nodes) - 1
    p = FIRST
    while p < last:
        q = neighbour(touches, p, NEXT)
        unit, line = straight(touches, p, q)
        possible &= line > 0.0
        _share_line(touches, p, q)
        begin = 0.0
        for e in range(p, q):
            end = touches[e + 1].share if e + 1 < q else 1.0
            length[e] = (end - begin) * line
            direction[e, 0], direction[e, 1], direction[e, 2] = unit
            begin = end
        p = q
    for k in range(1, last):
        kind, touch = plans[k].kind, touches[k]
        if touch.touching == 0.0:
            wrap[k - 1] = 0.0
            continue
        if kind == POINT or nodes[k].inside == 1.0:
            u = (direction[k - 1, 0], direction[k - 1, 1], direction[k - 1, 2])
            v = (direction[k, 0], direction[k, 1], direction[k, 2])
            touch.wrap = atan2(norm(cross(u, v)), dot(u, v))
        elif kind == SHEATH:
            touch.wrap = wrap[k - 1]  # given by a constant and tables
        else:
            measure(nodes[k], kind, touch)
        wrap[k - 1] = touch.wrap
        possible &= touch.wrap >= 0.0
        length[k - 1] += 0.5 * touch.arc
        length[k] += 0.5 * touch.arc
    return possible
