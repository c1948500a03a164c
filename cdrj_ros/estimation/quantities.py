"""What load cells and motors' efforts measure, and which cables they correct."""

from __future__ import annotations

from typing import NamedTuple

from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Winch


class Quantity(NamedTuple):
    """The quantity that a sensor measures: the tension of an element, or a motor's effort."""

    column: int
    """Its column in the spread."""
    cables: list[int]
    """The cables that a reading of it corrects."""
    motor: int = -1
    """Index of the motor whose effort it is; -1 for a tension."""

    @property
    def is_effort(self) -> bool:
        """Whether it is a motor's effort."""
        return self.motor >= 0


def quantities_of(model: Model) -> dict[str, Quantity]:
    """The quantities by the names of their sensors: ``cable/element``, or a motor."""
    layout, robot = model.layout, model.robot
    cable_of = {name: c for c, cable in enumerate(robot.cables) for name in cable.element_names}
    found = {name: Quantity(k, [cable_of[name]]) for k, name in enumerate(layout.elements)}
    first_motor = len(layout.elements) + len(layout.pulleys)
    for k, motor in enumerate(layout.motors):
        cables = [
            c
            for c, cable in enumerate(robot.cables)
            if any(isinstance(node, Winch) and node.motor == motor for node in cable.nodes)
        ]
        found[motor] = Quantity(first_motor + k, cables, k)
    return found
