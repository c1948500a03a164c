"""A robot prepared for the compiled core: two flat arrays, layout and names of the results."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.division import divided
from cdrj_ros.model.elasticity import elasticity_of, strain_at
from cdrj_ros.model.filling import pack
from cdrj_ros.model.impossible import reason
from cdrj_ros.model.packing import (
    Sizes,
    Views,
    constant_views,
    topology_views,
)
from cdrj_ros.model.state import (
    scratch_views,
)
from cdrj_ros.robot.description import Robot, Winch

RANGE_CHECKS: Final = 41
"""Number of poses per joint in which the geometry is checked."""

MOST_ANGLES: Final = 65_600
"""Largest number of angles in these poses, of a robot with many joints."""


@dataclass(frozen=True)
class Layout:
    """Slices of all results in the estimate, and the names of their entries."""

    elements: tuple[str, ...]
    """``cable/element``, the order of ``tension`` and ``status``."""
    pulleys: tuple[str, ...]
    """``cable/node``, the order of everything that belongs to pulleys."""
    base_link: str
    """Name in tf of the robot's base frame."""
    force_frame: str
    """Frame of forces: ``base_link``; empty where all forces are in the frames of their pulleys."""
    motors: tuple[str, ...]
    joints: tuple[str, ...]
    cables: tuple[str, ...]
    element_before: NDArray[np.intp] = field(compare=False, repr=False)
    """Index of the element before every pulley; the next index is the one after it.  Read-only."""
    size: int
    """Floats of one estimate."""
    tension: slice
    """[N]."""
    status: slice
    """Bit flags, see ``cdrj_ros.model.state``."""
    force_x: slice
    """[N], of the cable on the pulley."""
    force_y: slice
    """[N]."""
    force_z: slice
    """[N]; 0 for cables in a plane."""
    magnitude: slice
    """[N], eq. (38)."""
    friction: slice
    """t_i - t_{i-1} [N]."""
    slip_speed: slice
    """[m/s], positive towards the last node."""
    motor_effort: slice
    """[N m]."""
    joint_effort: slice
    """[N m], of a prismatic joint [N]."""
    iterations: slice
    """Newton iterations of every cable."""
    residual: slice
    """Largest force imbalance at a pulley of every cable [N]."""
    correction: slice
    """Learned correction that is part of an output [N] or [N m]."""
    trust: slice
    """Share of it that applies."""

    def in_frame(self, base_link: str) -> Layout:
        """The layout with another name of the base frame; empty: this one."""
        base = base_link or self.base_link
        return replace(self, base_link=base, force_frame=base if self.force_frame else "")

    def pulley_status(self, status: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Flags of pulleys, shape (..., pulleys): the union of those of both adjacent elements.

        Args:
            status: flags of the elements, shape (..., elements).
        """
        before = self.element_before
        return status[..., before] | status[..., before + 1]


@dataclass(frozen=True)
class Model:
    """A robot, ready to be stepped."""

    robot: Robot
    topology: NDArray[np.int64]
    """Connections of its parts, see ``cdrj_ros.model.packing``; read-only."""
    constants: Vector
    """Its constants, see ``cdrj_ros.model.packing``; read-only."""
    sizes: Sizes
    """Numbers of its parts."""
    layout: Layout
    core: _core.Robot = field(init=False, compare=False, repr=False)
    """The robot as the compiled core reads it, from ``topology`` and ``constants``."""

    def __post_init__(self) -> None:
        """Hand the robot to the core."""
        object.__setattr__(self, "core", _core.Robot(self.topology, self.constants))

    @property
    def state_size(self) -> int:
        """Numbers of a state."""
        return self.core.state_size


@dataclass(frozen=True)
class Shape:
    """Geometry of all cables in one pose."""

    length: Vector
    """Length of every element, with its share of the arcs [m]."""
    segment: Vector
    """Length of every segment between contacts [m]; those of a pulley with one contact are the
    elements."""
    lever_arm: NDArray[np.float64]
    """Of every element about every joint [m], (E27), shape (elements, joints).  The effort of a
    joint is minus the sum of the tensions times these."""
    wrap: Vector
    """Of every pulley [rad]."""
    direction: NDArray[np.float64]
    """Unit vectors of routed elements in the base frame, shape (elements, 3)."""
    possible: bool
    """False where a tangent does not exist or a wrap is negative."""


def prepare(robot: Robot, check_range: bool = True) -> Model:
    """Prepare a robot for stepping, with its unstretched lengths, l_0 of (E2).

    Args:
        robot: the description.
        check_range: whether to check poses throughout the joint ranges.

    Raises:
        RobotFileError: the geometry is impossible somewhere in the joint ranges.
    """
    model, rest = _at_rest(robot)
    robot = divided(robot, rest.wrap)
    if robot is not model.robot:
        model, rest = _at_rest(robot)
    for name, length in zip(model.layout.elements, rest.length, strict=True):
        if not length > 0.0:
            raise RobotFileError(
                f"element {name} has the length {length:.4g} m in the reference pose "
                f"({robot.source})"
            )
    material: Any = constant_views(model.sizes, model.constants).segments
    for c, cable in enumerate(robot.cables):
        own = segments_of(model, c)
        stretch = 1.0 + strain_at(elasticity_of(cable), cable.preload)
        material["material"][own] = rest.segment[own] / stretch
    if check_range:
        _check_range(model)
    model.constants.flags.writeable = False
    return model


def _at_rest(robot: Robot) -> tuple[Model, Shape]:
    """A model without unstretched lengths, and its geometry in the reference pose.

    Raises:
        RobotFileError: the geometry is impossible there.
    """
    model = _model(robot)
    reference = robot.reference_pose
    rest, views = placed(model, reference)
    if not rest.possible:
        raise RobotFileError(reason(robot, reference, views))
    for c, cable in enumerate(robot.cables):
        if cable.placed:
            _set_references(model, c, views, reference)
    if model.sizes.frames:
        rest = shape_at(model, reference)
    return model, rest


def shape_at(model: Model, joint_angle: Vector, motor_angle: Vector | None = None) -> Shape:
    """Lengths (3), wraps and directions in a pose.

    Args:
        model: the robot.
        joint_angle: [rad] or [m], shape (joints,).
        motor_angle: [rad], shape (motors,); None for drums at rest.  Only drums with a pitch depend
            on it.
    """
    return placed(model, joint_angle, motor_angle)[0]


def placed(
    model: Model, joint_angle: Vector, motor_angle: Vector | None = None
) -> tuple[Shape, Views]:
    """As ``shape_at``; the second result is the scratch, with the poses of the frames."""
    scratch = np.zeros(model.core.scratch_size)
    drums = np.empty(0) if motor_angle is None else motor_angle
    possible = model.core.shape(drums, joint_angle, scratch)
    views = scratch_views(model.sizes, scratch)
    segments: Any = views.segments
    found = Shape(
        views.element_length,
        segments["length"],
        views.lever_arm,
        views.wrap,
        views.direction,
        possible,
    )
    return found, views


def segments_of(model: Model, c: int) -> slice:
    """Segments of a cable, in the order of the robot's."""
    cable = topology_views(model.topology).cables[c]
    first = int(cable.first_contact) + c
    return slice(first, first + int(cable.contacts) + 1)


def read_only(array: Vector) -> Vector:
    """A read-only view."""
    view = array.view()
    view.flags.writeable = False
    return view


def _model(robot: Robot) -> Model:
    """Pack a robot; the constants that follow from its reference pose are not yet set."""
    topology, constants = pack(robot)
    topology.flags.writeable = False
    parts = topology_views(topology)
    sizes = Sizes(*map(int, parts.sizes))
    return Model(
        robot=robot,
        topology=topology,
        constants=constants,
        sizes=sizes,
        layout=_layout(robot, parts.pulleys, sizes),
    )


def _layout(robot: Robot, rows: Any, sizes: Sizes) -> Layout:
    """Layout of the estimate, whose parts have the order of ``Estimate`` in ``core/layout.hpp``."""
    elements = tuple(name for cable in robot.cables for name in cable.element_names)
    pulleys = tuple(name for cable in robot.cables for name in cable.pulley_names)
    counts = [*2 * [sizes.elements], *6 * [sizes.pulleys], sizes.motors, sizes.joints]
    counts += [*2 * [sizes.cables], *2 * [sizes.residuals]]
    ends = np.cumsum([0, *counts]).tolist()
    slices = [slice(a, b) for a, b in pairwise(ends)]
    before = rows["element"].astype(np.intp)
    before.flags.writeable = False
    placed = any(cable.placed for cable in robot.cables)
    return Layout(
        elements,
        pulleys,
        robot.base_link,
        robot.base_link if placed else "",
        tuple(motor.name for motor in robot.motors),
        tuple(joint.name for joint in robot.joints),
        tuple(cable.name for cable in robot.cables),
        before,
        ends[-1],
        *slices,
    )


def _set_references(model: Model, c: int, rest: Views, reference: Vector) -> None:
    """Set the wraps and angles in the reference pose of a cable given by positions.

    Then its drums begin to wander.
    """
    topology = topology_views(model.topology)
    nodes: Any = constant_views(model.sizes, model.constants).nodes
    touches: Any = rest.touches
    twists: Any = rest.twist
    first = topology.cables[c].first_node
    last = first + topology.cables[c].elements
    inner = slice(first + 1, last)
    nodes["arc_reference"][inner] = touches["angle"][inner]
    for index, k in ((first, 0), (last, -1)):
        end = model.robot.cables[c].nodes[k]
        angular = twists["angular"][topology.nodes[index].frame]
        turn = float(reference @ (angular @ touches["basis"][index, 6:9]))
        nodes["turn_reference"][index] = turn
        nodes["arc_reference"][index] = touches["angle"][index] + turn
        nodes["lead"][index] = end.lead if isinstance(end, Winch) else 0.0


def poses_in_range(robot: Robot) -> NDArray[np.float64]:
    """Joint angles throughout the ranges [rad] or [m], shape (poses, joints)."""
    joints = robot.joints
    if not joints:
        return np.empty((1, 0))
    if len(joints) == 1:
        shares = np.linspace(0.0, 1.0, RANGE_CHECKS)[:, None]
    else:  # both ends of all ranges, then random poses
        generator = np.random.default_rng(0)
        poses = min(RANGE_CHECKS * len(joints), max(RANGE_CHECKS, MOST_ANGLES // len(joints)))
        shares = generator.random((poses, len(joints)))
        shares[0], shares[1] = 0.0, 1.0
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    return np.asarray(lower + shares * (upper - lower))


def _check_range(model: Model) -> None:
    """Check that the geometry is possible throughout the joint ranges, in sampled poses."""
    if not model.robot.joints:
        return
    angles = poses_in_range(model.robot)
    for first in range(0, len(angles), RANGE_CHECKS):
        some = angles[first : first + RANGE_CHECKS]
        found, done = course_of(model, some)
        fine = np.all(found.length[:done] > 0.0, axis=1) & np.all(found.wrap[:done] >= 0.0, axis=1)
        first_wrong = done if fine.all() else int(np.argmin(fine))
        if first_wrong < len(some):
            angle = some[first_wrong]
            raise RobotFileError(reason(model.robot, angle, placed(model, angle)[1]))


@dataclass(frozen=True)
class Course:
    """Geometry over n poses, each of which follows from the one before by a small motion."""

    length: Table
    """Of every element with its share of the arcs [m], shape (n, elements)."""
    lever_arm: NDArray[np.float64]
    """Of every element about every joint [m], (E27), shape (n, elements, joints)."""
    wrap: Table
    """Of every pulley [rad], shape (n, pulleys)."""
    arc: Table
    """Length of cable on every pulley [m], shape (n, pulleys)."""
    track: Table
    """Place of the middle of every pulley's arc along its path on the body [m], up to a constant,
    (E26), shape (n, pulleys)."""


def course_of(model: Model, joint_angle: Table) -> tuple[Course, int]:
    """Geometry along a motion with drums at rest, and the poses before the first impossible one.

    Args:
        model: the robot.
        joint_angle: [rad] or [m], shape (n, joints), contiguous.
    """
    n, sizes = joint_angle.shape[0], model.sizes
    length, lever_arm = np.empty((n, sizes.elements)), np.empty((n, sizes.elements * sizes.joints))
    wrap, arc, track = (np.empty((n, sizes.pulleys)) for _ in range(3))
    done = model.core.course(joint_angle, length, lever_arm, wrap, arc, track)
    arms = lever_arm.reshape(n, sizes.elements, sizes.joints)
    return Course(length, arms, wrap, arc, track), done


TENSION: Final = "tension"
"""``tension/cable/element`` [N]."""
NODAL_FORCE: Final = "nodal_force"
"""``nodal_force/cable/node``, the magnitude [N]."""
EFFORT: Final = "effort"
"""``effort/motor`` or ``effort/joint`` [N m], [N] for a prismatic joint."""


def channel_columns(layout: Layout) -> dict[str, int]:
    """Columns of tensions, nodal forces, motor and joint efforts in an estimate, by channel."""
    named: dict[str, int] = {}
    for prefix, names, where in (
        (TENSION, layout.elements, layout.tension),
        (NODAL_FORCE, layout.pulleys, layout.magnitude),
        (EFFORT, layout.motors, layout.motor_effort),
        (EFFORT, layout.joints, layout.joint_effort),
    ):
        named |= {f"{prefix}/{name}": where.start + k for k, name in enumerate(names)}
    return named
