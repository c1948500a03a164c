"""The number of contact cells of every pulley, where the robot file leaves it open.

One contact holds the friction of a whole arc at one place.  Its error grows with the square of the
capstan exponent rho mu beta and falls with the square of the number of cells: docs/model.md,
section 4.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import Any, Final

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.robot.description import Cable, Node, Pulley, Robot, friction_law

EXPONENT_PER_CELL: Final = 0.13
"""Largest capstan exponent of one cell [-]."""

MOST_CELLS: Final = 64
"""Largest number of cells of one pulley, as in the schema of robot files."""


def divided(robot: Robot, wrap: Vector) -> Robot:
    """The robot with a number of cells for every pulley, in its document too.

    Robots that differ from it in their numbers only then have the same cells, whatever their
    friction: members of an ensemble, trials of an identification.

    Args:
        robot: the description.
        wrap: of every pulley in the reference pose [rad], shape (pulleys,).
    """
    if all(pulley.cells for cable in robot.cables for pulley in cable.pulleys):
        return robot
    cables, first = [], 0
    for cable in robot.cables:
        own = wrap[first : first + len(cable.pulleys)]
        first += len(cable.pulleys)
        cells = [_cells(cable, *one) for one in zip(cable.pulleys, own, strict=True)]
        inner = tuple(
            replace(node, cells=count) for node, count in zip(cable.pulleys, cells, strict=True)
        )
        nodes: tuple[Node, ...] = (cable.nodes[0], *inner, cable.nodes[-1])
        cables.append(replace(cable, nodes=nodes))
    chosen = replace(robot, cables=tuple(cables))
    return replace(chosen, document=_stated(chosen)) if robot.document else chosen


def _cells(cable: Cable, pulley: Pulley, wrap: float) -> int:
    if pulley.cells:
        return pulley.cells
    if not friction_law(cable.law).sliding or pulley.kind == "eyelet":
        return 1
    exponent = pulley.friction.rho * pulley.friction.mu_c * wrap
    return min(max(ceil(exponent / EXPONENT_PER_CELL), 1), MOST_CELLS)


def _stated(robot: Robot) -> dict[str, Any]:
    """The robot's document with the cells of every pulley; it may have cables that it has not."""
    document: dict[str, Any] = dict(robot.document)
    cables = {cable.name: cable for cable in robot.cables}
    document["cables"] = [
        {**entry, "nodes": _nodes_with_cells(cables[entry["name"]], entry["nodes"])}
        if entry["name"] in cables
        else entry
        for entry in document["cables"]
    ]
    return document


def _nodes_with_cells(cable: Cable, entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    guides = [
        entry if pulley.kind == "eyelet" else {**entry, "cells": pulley.cells}
        for pulley, entry in zip(cable.pulleys, entries[1:-1], strict=True)
    ]
    return [entries[0], *guides, entries[-1]]
