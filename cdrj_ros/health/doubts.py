"""Elements whose estimate a verdict of the health monitor calls into question.

While the readings show that the robot differs from its file, the estimates of the cables concerned
are wrong by more than their standard deviation may say, so they must not have the status OK.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.health.changes import Change
from cdrj_ros.health.judging import Judged
from cdrj_ros.robot.description import Robot

Flags = NDArray[np.bool_]


def doubted_elements(robot: Robot, standing: Judged | None, *, corrected: bool) -> Flags:
    """Whether each element's tension is in doubt, shape (elements,).

    A change of one cable that nothing else explains as well concerns that cable.  Every other
    verdict concerns all elements: one effort seldom tells the changes of several cables apart.

    Args:
        robot: the robot as its file describes it.
        standing: the verdict; None while the robot agrees with its file.
        corrected: whether efforts or load cells correct the preloads of the estimate; its standard
            deviation then contains what they leave open, and a change of preload is no reason.
    """
    sizes = [len(cable.element_names) for cable in robot.cables]
    flags = np.zeros(sum(sizes), dtype=np.bool_)
    if standing is None:
        return flags
    if not standing.explained:
        return ~flags
    for found in standing.found:
        if found.matters and not (corrected and found.change.kind == "preload"):
            concerned = _cables(robot, found.change, alone=not found.others)
            flags |= np.repeat(concerned, sizes)
    return flags


def _cables(robot: Robot, change: Change, *, alone: bool) -> list[bool]:
    """Whether each cable is concerned by a change."""
    if change.kind in ("preload", "broken") and alone and change.robot is not None:
        return [a != b for a, b in zip(robot.cables, change.robot.cables, strict=True)]
    return [True] * len(robot.cables)
