"""What load cells and motors' efforts measure, and which cables they correct."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Winch


class Quantity(NamedTuple):
    """The quantity that a sensor measures: the tension of an element, or a motor's effort."""

    column: int
    """Its column in the spread."""
    cables: list[int]
    """The cables that a reading of it corrects."""
    others: NDArray[np.int64]
    """The columns that it does not correct: those of other cables, but no efforts."""
    motor: int = -1
    """Index of the motor whose effort it is; -1 for a tension."""

    @property
    def is_effort(self) -> bool:
        """Whether it is a motor's effort."""
        return self.motor >= 0


def quantities_of(model: Model) -> dict[str, Quantity]:
    """The quantities by the names of their sensors: ``cable/element``, or a motor."""
    layout, robot = model.layout, model.robot
    columns = [name.rsplit("/", 1)[0] for name in (*layout.elements, *layout.pulleys)]
    cables = [layout.cables.index(name) for name in columns]

    def others(own: list[int]) -> NDArray[np.int64]:
        return np.flatnonzero(~np.isin(cables, own))

    found = {
        name: Quantity(k, [cables[k]], others([cables[k]]))
        for k, name in enumerate(layout.elements)
    }
    first_motor = len(layout.elements) + len(layout.pulleys)
    for k, motor in enumerate(layout.motors):
        own = [
            c
            for c, cable in enumerate(robot.cables)
            if any(isinstance(node, Winch) and node.motor == motor for node in cable.nodes)
        ]
        found[motor] = Quantity(first_motor + k, own, others(own), k)
    return found
