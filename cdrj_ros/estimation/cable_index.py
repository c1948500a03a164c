"""One cable's values in states, constants and deviations of the ensemble."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.laws import Elasticity, contact_cells, elasticities, strain_at, tensions_at
from cdrj_ros.model.packing import constant_views, state_views, topology_views
from cdrj_ros.model.prepared import Model, segments_of, shape_at
from cdrj_ros.robot.description import Winch


class CableStates(NamedTuple):
    """One cable's values in a state, or in every row of a table of states: views."""

    length: Table
    """Of the segments [m], shape (segments,) or (rows, segments), as those that follow."""
    material: Table
    """[m]."""
    bristle: Table
    """[N], shape (contacts,) or (rows, contacts)."""
    law: Elasticity
    """Of every row, shapes (1,) or (rows, 1)."""
    between: Table | None
    """Weights of the elements at every segment, shape (elements, segments); None where the segments
    are the elements."""

    def stretch(self, shift: Table) -> Vector:
        """Change the tensions by ``shift`` [N], of shape (..., 1) or (..., elements).

        Between the cells of a pulley it is interpolated.

        Returns:
            Change of the cable's material [m], shape () or (rows,).
        """
        length, material, law = self.length, self.material, self.law
        # most cables are linear, and the general law takes three times as long
        linear = not law.bedding_strain.any()
        strain = length / material
        strain -= 1.0
        tension = law.axial_stiffness * strain if linear else tensions_at(law, strain)
        if self.between is not None and shift.shape[-1] > 1:
            shift = shift @ self.between
        tension = tension + shift
        strain = tension / law.axial_stiffness if linear else strain_at(law, tension)
        strain += 1.0
        before = np.add.reduce(material, axis=-1)
        np.divide(length, strain, out=material)
        taut = np.maximum(tension, 0.0)
        np.subtract(taut[..., 1:], taut[..., :-1], out=self.bristle)
        change: Vector = np.add.reduce(material, axis=-1) - before
        return change


class CableIndex:
    """Indices of one cable's values in states, constants and deviations."""

    def __init__(self, model: Model, c: int) -> None:
        """Find the indices.

        Args:
            model: the prepared robot.
            c: number of the cable.
        """
        robot, layout = model.robot, model.layout
        cable = topology_views(model.topology).cables[c]
        first, pulley = cable.first_element, cable.first_pulley
        elements = len(layout.elements)
        self.elements = slice(first, first + cable.elements)
        self.pulleys = slice(elements + pulley, elements + pulley + cable.pulleys)
        segments, contact = segments_of(model, c), cable.first_contact
        constants = constant_views(model.sizes, np.arange(float(model.constants.size)))
        rows: Any = constants.segments
        self._material_columns = _columns(rows["material"][segments])
        self._law_columns = [int(k) for k in elasticities(constants.cables[c])]
        state = state_views(model.sizes, np.arange(float(model.state_size)))
        self._length_part = _columns(state.length[segments])
        self._material_part = _columns(state.material[segments])
        self._bristle_part = _columns(state.bristle[contact : contact + cable.contacts])
        self._between = _between([contact_cells(one) for one in robot.cables[c].pulleys])
        shape = shape_at(model, robot.reference_pose)
        self.lever = 2.0 * np.sin(0.5 * shape.wrap[pulley : pulley + cable.pulleys])
        """Force on every pulley per newton of tension [-]."""
        self._length = shape.segment[segments]
        length = shape.length[self.elements]
        self.weight = length / length.sum()
        """Share of every element in the cable's mean tension, which slip does not change [-]."""
        motors = {motor.name: k for k, motor in enumerate(robot.motors)}
        offset = elements + len(layout.pulleys)
        self.motors = [
            (
                offset + motors[node.motor],
                -robot.motors[motors[node.motor]].effort_sign * node.winding * node.radius,
            )
            for node in (robot.cables[c].nodes[0], robot.cables[c].nodes[-1])
            if isinstance(node, Winch)
        ]

    def states(self, states: Table, constants: Table) -> CableStates:
        """The cable's values.

        Args:
            states: a state, shape (state_size,), or many, shape (rows, state_size).
            constants: of the prepared robot, or of that of every row.
        """
        return CableStates(
            states[..., self._length_part],
            states[..., self._material_part],
            states[..., self._bristle_part],
            self._law(constants),
            self._between,
        )

    def start(self, constants: Table) -> Table:
        """Material of the cable's segments in the reference pose [m], a view of ``constants``."""
        return constants[..., self._material_columns]

    def preload(self, constants: Table, shift: Vector) -> None:
        """Let states begin with other preloads, but at least 0.

        Args:
            constants: of the prepared robots, shape (rows, constants), changed.
            shift: of the preload [N], shape (rows,).
        """
        law, material = self._law(constants), self.start(constants)
        tension = tensions_at(law, self._length / material - 1.0) + shift[:, None]
        material[:] = self._length / (1.0 + strain_at(law, np.maximum(tension, 0.0)))

    def _law(self, constants: Table) -> Elasticity:
        """The cable's law of every row of ``constants``."""
        return Elasticity(*(constants[..., column, None] for column in self._law_columns))


def lengthen(start: Table, change: Vector) -> None:
    """Let states begin with more material, so that they know a correction of the preload.

    Args:
        start: see ``CableIndex.start``, shape (segments,) or (rows, segments), changed.
        change: of the cable's material [m], shape () or (rows,).
    """
    start *= 1.0 + (change / np.add.reduce(start, axis=-1))[..., None]


def _between(cells: list[int]) -> Table | None:
    """Weights that interpolate from elements to segments, shape (elements, segments).

    Args:
        cells: number of contact cells of every pulley; with one each, None is returned.
    """
    if all(count == 1 for count in cells):
        return None
    at = np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(cells))])
    elements = np.arange(len(cells) + 1.0)
    weights: Table = np.maximum(1.0 - np.abs(elements[:, None] - at), 0.0)
    return weights


def _columns(indices: Vector) -> slice:
    """Indices at equal distances as a slice, which costs a view less than names of the parts."""
    step = int(indices[1] - indices[0]) if indices.size > 1 else 1
    return slice(int(indices[0]), int(indices[-1]) + 1, step) if indices.size else slice(0, 0)
