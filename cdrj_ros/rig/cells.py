"""Division of contacts: every pulley gets many contact cells, each with its own bristle.

The estimator's cells are equal parts of an arc and move with it.  Where an end of an arc moves on
its body, the rig's cells are fixed to the body's surface instead: see ``Surfaces`` of the compiled
core.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.along import course
from cdrj_ros.model.prepared import poses_in_range, prepare
from cdrj_ros.robot.description import Node, Pulley, Robot, Winch

Vector = NDArray[np.float64]

AT_REST: Final = 1e-9
"""Motion of an arc on its body below which its ends do not move [m]."""

LONGER: Final = 1.05
"""Longest arc for which cells are at hand, relative to that in the sampled poses; the last cell
takes what is longer still."""


def divide_contacts(robot: Robot, cells: int) -> Robot:
    """The same robot with contact cells on every pulley; an eyelet, which has no arc, stays whole.

    Args:
        robot: the robot.
        cells: number of cells of the longest arc of every pulley.  With one cell, pulleys are
            those of the estimator.

    Raises:
        RobotFileError: the geometry is impossible in the reference pose.
    """
    count = sum(len(cable.pulleys) for cable in robot.cables)
    widths = cells_on_surfaces(robot, cells) if cells > 1 else np.zeros(count)
    cables, first = [], 0
    for cable in robot.cables:
        nodes: list[Node] = []
        for node in cable.nodes:
            if isinstance(node, Pulley):
                nodes.append(_divided(node, cells, float(widths[first])))
                first += 1
            else:
                nodes.append(node)
        cables.append(replace(cable, nodes=tuple(nodes)))
    return replace(robot, cables=tuple(cables))


def _divided(pulley: Pulley, cells: int, width: float) -> Pulley:
    if pulley.kind == "eyelet":
        return replace(pulley, cells=1)
    if width > 0.0:  # an arc of n widths covers parts of n + 1 cells
        return replace(pulley, cells=cells + 1, cell_width=width)
    return replace(pulley, cells=cells)


def cells_on_surfaces(robot: Robot, cells: int) -> Vector:
    """Width of every pulley's cells on its surface [m]; 0 where no end of its arc moves on it.

    Args:
        robot: the robot.
        cells: number of cells of the longest arc.
    """
    model = prepare(robot, check_range=False)
    found = course(model, poses_in_range(robot))
    moving = (np.ptp(found.arc, axis=0) > AT_REST) | (np.ptp(found.track, axis=0) > AT_REST)
    moving |= _beside_wandering_drums(robot)
    longest = found.arc.max(axis=0)
    return np.where(moving & (longest > AT_REST), LONGER * longest / cells, 0.0)


def _beside_wandering_drums(robot: Robot) -> NDArray[np.bool_]:
    """Whether each pulley is the neighbour of a drum along which the cable wanders."""
    beside: list[bool] = []
    for cable in robot.cables:
        own = [False] * len(cable.pulleys)
        for k in (0, -1):
            end = cable.nodes[k]
            if own and isinstance(end, Winch) and end.lead != 0.0:
                own[k] = True
        beside += own
    return np.array(beside, dtype=np.bool_)
