"""Pack the description of a robot into ``topology`` and ``constants``, which the core reads."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import cos, pi, sin
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros._core import Law, Stribeck, blended_loss
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.laws import contact_cells, elasticity_of, friction_numbers, stribeck_of
from cdrj_ros.model.packing import (
    TENSION,
    Indices,
    Sizes,
    Views,
    channel_columns,
    code_of,
    constant_views,
    empty_robot,
    layout_of,
    topology_views,
)
from cdrj_ros.robot.description import (
    TABLE_INTERVALS,
    Cable,
    MovingEnd,
    Node,
    Profile,
    Pulley,
    Robot,
    Winch,
    friction_law,
    turns_of,
)

MOVED_AFTER: Final[dict[MovingEnd, float]] = {"before": -0.5, "both": 0.0, "after": 0.5}
"""Motion of the middle of an arc per growth of the arc, by the end that moves [-]."""


def pack(robot: Robot) -> tuple[Indices, Vector]:
    """Topology and constants of a robot.

    Quantities that follow from the reference pose keep their initial values: unstretched lengths,
    and the angles about which the arcs of routed cables are continuous.
    """
    sizes = _sizes(robot)
    topology, constants = empty_robot(sizes)
    rows = _Rows(robot, topology_views(topology), constant_views(sizes, constants))
    rows.axes()
    rows.frames()
    for c in range(len(robot.cables)):
        rows.cable(c)
    if robot.residuals:
        rows.residuals(channel_columns(layout_of(robot, topology)))
    return topology, constants


def _sizes(robot: Robot) -> Sizes:
    """How many of each thing the robot has."""
    cables = robot.cables
    nodes = sum(len(cable.nodes) for cable in cables)
    return Sizes(
        motors=len(robot.motors),
        joints=len(robot.joints),
        cables=len(cables),
        elements=nodes - len(cables),
        pulleys=nodes - 2 * len(cables),
        contacts=sum(contact_cells(pulley) for cable in cables for pulley in cable.pulleys),
        frames=len(robot.frames),
        nodes=nodes if robot.frames else 0,
        terms=sum(1 for cable in cables for profile in cable.profiles if profile.joint),
        drums=sum(_takes_up(node) for cable in cables for node in _ends(cable)),
        turns=sum(len(turns_of(node)) for cable in cables for node in _ends(cable)),
        surfaces=sum(pulley.cell_width > 0.0 for cable in cables for pulley in cable.pulleys),
        residuals=len(robot.residuals),
        residual_inputs=sum(len(one.inputs) for one in robot.residuals),
        residual_weights=sum(one.weights.size for one in robot.residuals),
    )


def _ends(cable: Cable) -> tuple[Node, Node]:
    """The first and the last node of a cable."""
    return cable.nodes[0], cable.nodes[-1]


def _takes_up(end: Node) -> bool:
    """Whether an end takes up cable: a drum, or a sector on a frame that turns."""
    return isinstance(end, Winch) or end.radius > 0.0


def _fill(rows: Any, index: int, **fields: float | tuple[float, ...]) -> None:
    """Set all fields of one row of a structured array by name; vectors are given as tuples."""
    names = rows.dtype.names
    rows[index] = tuple([fields[name] for name in names])
    if len(fields) > len(names):
        raise TypeError(f"no such fields: {', '.join(fields.keys() - names)}")


class _Rows:
    """Fills the rows of a topology and its constants, cable after cable."""

    def __init__(self, robot: Robot, topology: Views, constants: Views) -> None:
        self._robot, self._topology, self._constants = robot, topology, constants
        self._motors = {motor.name: k for k, motor in enumerate(robot.motors)}
        self._joints = {joint.name: k for k, joint in enumerate(robot.joints)}
        self._frames = {frame.name: k for k, frame in enumerate(robot.frames)}
        self._node = 0
        self._term = 0
        self._drums = self._turn = 0
        self._contact = 0
        self._surface = 0

    def axes(self) -> None:
        """Fill the rows of motors, of joints, and of the passive torques of both."""
        for k, motor in enumerate(self._robot.motors):
            _fill(self._constants.motors, k, reference_angle=motor.reference_angle)
        for k, joint in enumerate(self._robot.joints):
            interval = (joint.upper - joint.lower) / TABLE_INTERVALS
            _fill(self._constants.joints, k, lower=joint.lower, interval=interval)
        for k, axis in enumerate(self._robot.axes):
            sign = axis.effort_sign
            _fill(self._constants.axes, k, effort_sign=sign, **vars(axis.passive))

    def frames(self) -> None:
        """Fill the rows of frames, parents first."""
        for k, frame in enumerate(self._robot.frames):
            _fill(
                self._topology.frames,
                k,
                parent=self._frames[frame.parent] if frame.parent else -1,
                motion=code_of(_core.FrameMotion, frame.motion),
                joint=self._joints[frame.joint] if frame.joint else -1,
            )
            _fill(
                self._constants.frames,
                k,
                origin=frame.origin,
                rotation=frame.rotation,
                axis=frame.axis,
                rolling_radius=frame.rolling_radius,
                multiplier=frame.multiplier,
                offset=frame.offset,
            )

    def residuals(self, columns: Mapping[str, int]) -> None:
        """Fill the rows of the learned corrections; ``columns``: of the outputs in an estimate."""
        axes = {axis.name: a for a, axis in enumerate(self._robot.axes)}
        cables = {
            f"{TENSION}/{name}": c
            for c, cable in enumerate(self._robot.cables)
            for name in cable.element_names
        }
        entry = weight = 0
        for r, one in enumerate(self._robot.residuals):
            _fill(
                self._topology.residuals,
                r,
                column=columns[one.output],
                cable=cables.get(one.output, -1),
                first_input=entry,
                inputs=len(one.inputs),
                first_weight=weight,
            )
            _fill(self._constants.residuals, r, bound=one.bound, variance=one.stddev**2)
            for name, (lower, upper) in one.inputs.items():
                _fill(
                    self._topology.residual_inputs,
                    entry,
                    axis=axes.get(name, -1),
                    column=columns.get(name, -1),
                )
                _fill(self._constants.residual_ranges, entry, lower=lower, upper=upper)
                entry += 1
            self._constants.residual_weights[weight : weight + one.weights.size] = (
                one.weights.ravel()
            )
            weight += one.weights.size

    def cable(self, c: int) -> None:
        """Fill the rows of one cable and its parts; call this in the order of the cables."""
        cable = self._robot.cables[c]
        element, pulley = self._node - c, self._node - 2 * c
        _fill(
            self._topology.cables,
            c,
            first_element=element,
            elements=len(cable.nodes) - 1,
            first_pulley=pulley,
            pulleys=len(cable.nodes) - 2,
            first_contact=self._contact,
            contacts=sum(contact_cells(one) for one in cable.pulleys),
            first_node=self._node,
            law=code_of(Law, cable.law),
            routed=int(cable.placed),
        )
        _fill(
            self._constants.cables,
            c,
            **elasticity_of(cable)._asdict(),
            creep_share=cable.creep_share,
            creep_time=cable.creep_time,
            flow_time=cable.flow_time,
            preload=cable.preload,
            maximum_tension=cable.maximum_tension,
            credible_tension=cable.credible_tension,
            wound_tension=cable.preload,
            slack_tension=cable.slack_tension,
        )
        for end, node in enumerate(_ends(cable)):
            turns = turns_of(node)
            _fill(
                self._topology.ends,
                2 * c + end,
                first_turn=self._turn,
                turns=len(turns),
                drum=self._drums if _takes_up(node) else -1,
            )
            self._drums += _takes_up(node)
            radius = node.effective_radius if isinstance(node, Winch) else node.radius
            _fill(self._constants.ends, 2 * c + end, radius=radius)
            for motor, winding in turns.items():
                _fill(self._topology.turns, self._turn, motor=self._motors[motor])
                _fill(self._constants.turns, self._turn, winding=winding)
                self._turn += 1
        stribeck = stribeck_of(cable)
        for k, node in enumerate(cable.pulleys):
            self._pulley(cable, node, stribeck, pulley + k, element + k)
        for k, profiles in enumerate(cable.spans or ((),) * (len(cable.nodes) - 1)):
            span = self._add_profiles(profiles, False, element + k)
            _fill(self._constants.elements, element + k, span=span)
        for node in cable.nodes:
            self._add_node(node)

    def _pulley(
        self, cable: Cable, pulley: Pulley, stribeck: Stribeck, index: int, element: int
    ) -> None:
        wrap = self._add_profiles(pulley.wrap, True, index)
        changes = cable.placed or any(profile.joint for profile in pulley.wrap)
        _fill(
            self._topology.pulleys,
            index,
            element=element,
            first_contact=self._contact,
            cells=contact_cells(pulley),
            surface=self._surface if pulley.cell_width > 0.0 else -1,
            wrap_changes=int(changes),
            stribeck=stribeck.value,
        )
        self._contact += contact_cells(pulley)
        self._surface += pulley.cell_width > 0.0
        values = friction_numbers(pulley, friction_law(cable.law))
        kinetic, static = blended_loss(
            values["rho"],
            values["mu_c"],
            values["mu_s"],
            wrap,
            values["bearing_ratio"],
            stribeck,
        )
        _fill(
            self._constants.pulleys,
            index,
            radius=pulley.radius,
            wrap=wrap,
            moved_after=MOVED_AFTER[pulley.moving_end],
            cell_width=pulley.cell_width,
            kinetic_loss=kinetic,
            static_loss=static,
            half_sine=sin(0.5 * wrap),
            half_cosine=cos(0.5 * wrap),
            **values,
        )

    def _add_node(self, node: Node) -> None:
        """Fill the body of a node; a pulley's arc reference is pi until the pose is known."""
        k, place = self._node, node.place
        self._node += 1
        if not self._frames:
            return
        if place is None:
            _fill(
                self._topology.nodes, k, kind=code_of(_core.Guide, "point"), frame=-1, exit_frame=-1
            )
            return
        _fill(
            self._topology.nodes,
            k,
            kind=code_of(_core.Guide, place.kind),
            frame=self._frames[place.frame],
            exit_frame=self._frames[place.exit_frame],
        )
        _fill(
            self._constants.nodes,
            k,
            centre=place.position,
            basis=_basis(place.axis),
            exit=place.exit,
            sided=float(place.sided),
            ignored_inside=float(place.ignored_inside),
            radius=node.radius,
            turn=float(place.turn),
            inside=float(place.inside),
            turns=float(place.turns),
            lead=0.0,
            effective_radius=node.effective_radius if isinstance(node, Winch) else node.radius,
            length=place.length,
            arc_reference=pi if isinstance(node, Pulley) else 0.0,
            turn_reference=0.0,
        )

    def _add_profiles(
        self, profiles: tuple[Profile, ...], adds_to_wrap: bool, target: int
    ) -> float:
        """Add the tables of functions of joint angles; returns the sum of the constants."""
        constant = 0.0
        for profile in profiles:
            if profile.joint is None:
                constant += float(profile.value[0])
                continue
            step = float(profile.angle[1] - profile.angle[0])
            joint, k = self._joints[profile.joint], self._term
            self._term += 1
            _fill(
                self._topology.terms, k, adds_to_wrap=int(adds_to_wrap), target=target, joint=joint
            )
            table: Any = self._constants.tables[k * TABLE_INTERVALS : (k + 1) * TABLE_INTERVALS]
            table.view(np.float64)[:] = hermite_table(profile.value, profile.slope, step).ravel()
        return constant


@lru_cache(maxsize=256)
def _basis(axis: tuple[float, float, float]) -> tuple[float, ...]:
    """Right-handed unit vectors by rows; the last is the axis.  The result is exact along z."""
    z = np.array(axis)
    helper = np.eye(3)[0 if abs(z[0]) < 0.9 else 1]
    x = helper - z * (helper @ z)
    x /= np.linalg.norm(x)
    return tuple(np.array([x, np.cross(z, x), z]).ravel())


def hermite_table(values: Vector, slopes: Vector, step: float) -> NDArray[np.float64]:
    """Cubic coefficients of a function sampled with its slopes on a uniform grid.

    Args:
        values: shape (k + 1,).
        slopes: derivatives at the same points, shape (k + 1,).
        step: distance of the points.

    Returns:
        Coefficients of the powers of u in [0, 1], one row per interval, shape (k, 4).
    """
    y0, y1 = values[:-1], values[1:]
    d0, d1 = slopes[:-1] * step, slopes[1:] * step
    return np.stack([y0, d0, 3 * (y1 - y0) - 2 * d0 - d1, 2 * (y0 - y1) + d0 + d1], axis=1)
