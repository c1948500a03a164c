"""A robot prepared for the compiled core, from its description or its file, and its geometry."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import RobotFileError, UsageError, nearest
from cdrj_ros.foundation.output import printable
from cdrj_ros.model.filling import pack
from cdrj_ros.model.impossible import reason
from cdrj_ros.model.laws import divided, elasticity_of, strain_at, tensions_at
from cdrj_ros.model.packing import (
    Layout,
    Sizes,
    Views,
    constant_views,
    layout_of,
    scratch_views,
    topology_views,
)
from cdrj_ros.robot.description import Robot, Winch
from cdrj_ros.robot.groups import part_of
from cdrj_ros.robot.reader import build_robot, load_robot

RANGE_CHECKS: Final = 41
"""Number of poses per joint in which the geometry is checked."""

MOST_ANGLES: Final = 65_600
"""Largest number of angles in these poses, of a robot with many joints."""


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
    touched: NDArray[np.bool_] = field(init=False, compare=False, repr=False)
    """Whether the cable of every element leads over an axis, shape (axes, elements).

    Those of all cables of a robot with joints without encoder, or with learned corrections.
    """

    def __post_init__(self) -> None:
        """Hand the robot to the core."""
        core = _core.Robot(self.topology, self.constants)
        touched = core.touched | bool(self.robot.unmeasured or self.robot.residuals)
        object.__setattr__(self, "core", core)
        object.__setattr__(self, "touched", np.asarray(self.robot.per_element(touched.T).T))

    @property
    def connections(self) -> Views:
        """Views of ``topology``."""
        return topology_views(self.topology)

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
    """Prepare a robot for stepping, with its unstretched lengths, l_0 of (E2) or (E30).

    Args:
        robot: the description.
        check_range: whether to check poses throughout the joint ranges.

    Raises:
        RobotFileError: the geometry is impossible somewhere in the joint ranges.
    """
    model, rest = _at_rest(_model(robot))
    if (fine := divided(robot, rest.wrap)) is not robot:
        model, rest = _at_rest(_model(fine))
    model = _settled(model, rest)
    if check_range:
        _check_range(model)
    model.constants.flags.writeable = False
    return model


def of_cables(model: Model, cables: Collection[int]) -> Model:
    """The robot with some of its cables only, and the axes that move them; with all, itself."""
    robot = model.robot
    if len(cables) == len(robot.cables):
        return model
    return prepare(build_robot(part_of(robot, cables), robot.source), check_range=False)


def mover_of(model: Model) -> Callable[[Mapping[str, float]], Model | None]:
    """A function that moves points of a prepared robot without reading the robot again.

    It takes changes of coordinates of frames' origins and nodes' positions, by path [m], and
    returns None where a path is none of these; it raises RobotFileError where the geometry is
    impossible in the reference pose.
    """
    robot = model.robot
    points: dict[str, tuple[str, str, int]] = {}
    for k, frame in enumerate(robot.frames):  # of those of a coupled joint, the first one counts
        points.setdefault(f"frames.{frame.name.partition('#')[0]}.origin", ("frames", "origin", k))
    nodes = [
        f"{cable.name}.nodes.{n + 1}" for cable in robot.cables for n in range(len(cable.nodes))
    ]
    for k, name in enumerate(nodes):
        points[f"cables.{name}.position"] = ("nodes", "centre", k)

    def moved(changes: Mapping[str, float]) -> Model | None:
        constants = model.constants.copy()
        views: Any = constant_views(model.sizes, constants)
        for path, change in changes.items():
            point, _, axis = path.rpartition(".")
            if point not in points:
                return None
            rows, column, k = points[point]
            getattr(views, rows)[column][k, int(axis) - 1] += change
        views.nodes["turn_reference"] = views.nodes["lead"] = 0.0
        return _settled(*_at_rest(replace(model, constants=constants)))

    return moved


def _settled(model: Model, rest: Shape) -> Model:
    """The model with its unstretched lengths, from the geometry in the reference pose."""
    views: Any = constant_views(model.sizes, model.constants)
    robot = _with_passive_preloads(model.robot, rest)
    if robot is not model.robot:
        model = replace(model, robot=robot)
        preloads = [cable.preload for cable in robot.cables]
        views.cables["preload"] = views.cables["wound_tension"] = preloads
    for name, length in zip(model.layout.elements, rest.length, strict=True):
        if not length > 0.0:
            raise RobotFileError(
                f"element {name} has the length {length:.4g} m in the reference pose "
                f"({robot.source})"
            )
    begin = 0
    for cable, contacts in zip(robot.cables, model.connections.cables["contacts"], strict=True):
        own = slice(begin, begin + int(contacts) + 1)
        begin = own.stop
        stretch = 1.0 + strain_at(elasticity_of(cable), cable.preload)
        if cable.rest_length:
            stretch = rest.segment[own].sum() / cable.rest_length
        views.segments["material"][own] = rest.segment[own] / stretch
    return model


def _with_passive_preloads(robot: Robot, rest: Shape) -> Robot:
    """The robot with the tensions of its passive cables in the reference pose (E30)."""
    if not any(cable.rest_length for cable in robot.cables):
        return robot
    cables = []
    for cable, elements in zip(robot.cables, robot.parts, strict=True):
        strain = rest.length[elements].sum() / (cable.rest_length or np.inf) - 1.0
        own = float(tensions_at(elasticity_of(cable), strain))
        cables.append(replace(cable, preload=own) if cable.rest_length else cable)
    return replace(robot, cables=tuple(cables))


def _at_rest(model: Model) -> tuple[Model, Shape]:
    """The model, still without unstretched lengths, and its geometry in the reference pose.

    Raises:
        RobotFileError: the geometry is impossible there.
    """
    reference = model.robot.reference_pose
    rest, views = placed(model, reference)
    if not rest.possible:
        raise RobotFileError(reason(model.robot, reference, views))
    if model.sizes.frames:
        _set_references(model, views, reference)
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


def lengths_at(model: Model, joint_angle: Table) -> Table:
    """Lengths of all elements in many poses, drums at rest [m], shape (poses, elements).

    Args:
        model: the robot.
        joint_angle: [rad] or [m], shape (poses, joints).
    """
    scratch = np.zeros(model.core.scratch_size)
    length = scratch_views(model.sizes, scratch).element_length
    found = np.empty((len(joint_angle), length.size))
    for k, pose in enumerate(joint_angle):
        model.core.shape(np.empty(0), pose, scratch)
        found[k] = length
    return found


def read_only(array: Vector) -> Vector:
    """A read-only view."""
    view = array.view()
    view.flags.writeable = False
    return view


def _model(robot: Robot) -> Model:
    """Pack a robot; the constants that follow from its reference pose are not yet set."""
    topology, constants = pack(robot)
    topology.flags.writeable = False
    return Model(
        robot=robot,
        topology=topology,
        constants=constants,
        sizes=topology_views(topology).sizes,
        layout=layout_of(robot, topology),
    )


def _set_references(model: Model, rest: Views, reference: Vector) -> None:
    """Set the wraps and angles in the reference pose of the cables given by positions.

    Then their drums begin to wander.
    """
    topology = model.connections
    nodes: Any = constant_views(model.sizes, model.constants).nodes
    angle, basis, angular = rest.touches["angle"], rest.touches["basis"], rest.twist["angular"]
    firsts, frames = topology.cables["first_node"].tolist(), topology.nodes["frame"]
    for first, cable in zip(firsts, model.robot.cables, strict=True):
        if not cable.placed:
            continue
        last = first + len(cable.nodes) - 1
        inner = slice(first + 1, last)
        nodes["arc_reference"][inner] = angle[inner]
        for index, end in ((first, cable.nodes[0]), (last, cable.nodes[-1])):
            turn = float(reference @ (angular[frames[index]] @ basis[index, 6:9]))
            nodes["turn_reference"][index] = turn
            nodes["arc_reference"][index] = angle[index] + turn
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


def load_model(path: str, preload: str | Sequence[float] | None = None) -> Model:
    """Read and prepare a robot file; a bare name means one of the installed ones.

    Args:
        path: the file, or the name of an installed robot.
        preload: preload of every cable [N], as numbers or as comma-separated text; None or empty
            keeps the preloads of the file.  Those of passive cables have no effect.

    Raises:
        CdrjError: the file or the preloads are invalid; the message is one line.
    """
    robot = load_robot(robot_path(path))
    if not preload:
        return prepare(robot)
    try:
        values = [float(v) for v in (preload.split(",") if isinstance(preload, str) else preload)]
    except ValueError as error:
        raise UsageError(f"preload must be numbers separated by commas, got {preload!r}") from error
    document: Any = robot.document
    cables = document["cables"]
    if len(values) != len(cables) or not all(0.0 <= value < 1e6 for value in values):
        raise UsageError(
            f"preload needs {len(cables)} tensions in [0, 1e6) N, one for each of "
            f"{', '.join(cable['name'] for cable in cables)}; got {preload!r}"
        )
    changed = [
        cable if "rest_length" in cable else cable | {"preload": value}
        for cable, value in zip(cables, values, strict=True)
    ]
    return prepare(build_robot({**document, "cables": changed}, robot.source))


def robot_path(path: str) -> Path:
    """Path of a robot file; a bare name means one of the installed ones.

    Raises:
        RobotFileError: no robot of that name is installed.
    """
    return installed_path(path, "robots", "robot file")


def installed_path(path: str, folder: str, kind: str) -> Path:
    """Path of a YAML file; a bare name means an installed one.

    Args:
        path: the file, or the name of one in the folder.
        folder: folder in the package's ``config``.
        kind: what such a file is called, for the error.

    Raises:
        RobotFileError: no file of that name is installed.
    """
    if not Path(path).exists() and "/" not in path and not path.endswith(".yaml"):
        folders = [config / folder for config in _installed_configs()]
        for place in folders:
            if (place / f"{path}.yaml").exists():
                return place / f"{path}.yaml"
        names = sorted({file.stem for place in folders for file in place.glob("*.yaml")})
        raise RobotFileError(
            f"there is no {kind} {printable(path)}, and none of that name is installed; "
            f"{nearest(path, names)}"
        )
    return Path(path)


def _installed_configs() -> Iterator[Path]:
    """Folders that may hold the package's own files: beside the source, or installed."""
    here = Path(__file__).resolve()
    yield here.parents[2] / "config"
    for parent in here.parents:
        yield parent / "share" / "cdrj_ros" / "config"
