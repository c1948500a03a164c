"""Division of contacts: every pulley gets many contact cells, each with its own bristle."""

from __future__ import annotations

from dataclasses import replace

from cdrj_ros.robot.description import Node, Pulley, Robot


def divide_contacts(robot: Robot, cells: int) -> Robot:
    """The same robot with every arc cut into contact cells; an eyelet, which has no arc, stays.

    Args:
        robot: the robot.
        cells: number of cells of every arc.
    """
    cables = tuple(
        replace(cable, nodes=tuple(_divided(node, cells) for node in cable.nodes))
        for cable in robot.cables
    )
    return replace(robot, cables=cables)


def _divided(node: Node, cells: int) -> Node:
    if not isinstance(node, Pulley) or node.kind == "eyelet":
        return node
    return replace(node, cells=cells)
