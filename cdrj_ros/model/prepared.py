"""A robot prepared for the compiled kernels: two flat arrays and the places of every result."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from itertools import pairwise
from math import cos, pi, sin
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model import cable as cable_kernel
from cdrj_ros.model import geometry, packing
from cdrj_ros.model.friction import (
    EULER,
    LAWS,
    RIGID_BRISTLE,
    STEADY,
    STRIBECK_FORMS,
    blended_loss,
)
from cdrj_ros.model.shape import shape
from cdrj_ros.robot.description import (
    TABLE_INTERVALS,
    Cable,
    Friction,
    Profile,
    Pulley,
    Robot,
    Winch,
)

Vector = NDArray[np.float64]

NEVER_SLIDES: Final = 1e9
"""Stribeck speed [m/s] that stands for 'no Stribeck effect'."""

RANGE_CHECKS: Final = 41
"""Poses over the joint ranges in which the geometry is checked."""


@dataclass(frozen=True)
class Layout:
    """Where each result lies in the estimate, and what its entries are called."""

    elements: tuple[str, ...]
    """``cable/element``, the order of ``tension`` and ``status``."""
    pulleys: tuple[str, ...]
    """``cable/node``, the order of everything that belongs to pulleys."""
    motors: tuple[str, ...]
    joints: tuple[str, ...]
    cables: tuple[str, ...]
    size: int
    """Floats of one estimate."""
    tension: slice
    """[N]."""
    status: slice
    """Bit flags, see ``cdrj_ros.model.status``."""
    force_x: slice
    """[N], of the cable on the pulley."""
    force_y: slice
    """[N]."""
    magnitude: slice
    """[N], eq. (38)."""
    friction: slice
    """t_i - t_{i-1} [N]."""
    slip_speed: slice
    """[m/s], positive towards the last node."""
    motor_effort: slice
    """[N m]."""
    joint_effort: slice
    """[N m]."""
    iterations: slice
    """Newton iterations of every cable."""
    residual: slice
    """Largest force imbalance at a pulley of every cable [N]."""


@dataclass(frozen=True)
class Model:
    """A robot, ready to be stepped."""

    robot: Robot
    plan: NDArray[np.int64]
    numbers: Vector
    layout: Layout
    state_size: int
    out_size: int
    """State, estimate and the kernel's scratch."""
    state_part: slice
    estimate_part: slice
    """Where state and estimate lie in what the kernel writes."""


@dataclass(frozen=True)
class Shape:
    """Geometry of all cables in one pose."""

    length: Vector
    """Of every element, with its share of the arcs [m]."""
    length_by_joint: NDArray[np.float64]
    """Derivatives by the joint angles, shape (elements, joints)."""
    wrap: Vector
    """Of every pulley [rad]."""
    direction: NDArray[np.float64]
    """Unit vectors of routed elements in the base frame, shape (elements, 2)."""
    possible: bool
    """False where a tangent does not exist or a wrap is negative."""


def prepare(robot: Robot, check_range: bool = True) -> Model:
    """Prepare a robot for stepping.

    Args:
        robot: the description.
        check_range: whether to look at poses all over the joint ranges.

    Raises:
        RobotFileError: the geometry is impossible somewhere in the joint ranges.
    """
    model = _pack(robot)
    reference = np.array([joint.reference_angle for joint in robot.joints])
    rest = shape_at(model, reference)
    if not rest.possible:
        raise RobotFileError(_impossible(robot, reference, rest))
    _set_routed_references(model, rest, reference)
    rest = shape_at(model, reference)
    numbers = model.numbers
    at = int(model.plan[packing.IN_MATERIAL])
    element = 0
    for cable in robot.cables:
        for _ in cable.element_names:
            length = rest.length[element]
            if not length > 0.0:
                raise RobotFileError(
                    f"element {cable.name}/{_number(model, element)} has the length {length:.4g} m "
                    f"in the reference pose ({robot.source})"
                )
            numbers[at + element] = length / (1.0 + cable.preload / cable.axial_stiffness)
            element += 1
    if check_range:
        _check_range(model)
    numbers.flags.writeable = False
    model.plan.flags.writeable = False
    return model


def shape_at(model: Model, joint_angle: Vector) -> Shape:
    """Lengths, wraps and directions at the joint angles [rad], shape (joints,)."""
    plan = model.plan
    elements, pulleys = int(plan[packing.ELEMENTS]), int(plan[packing.PULLEYS])
    joints, frames = int(plan[packing.JOINTS]), int(plan[packing.FRAMES])
    length, wrap = np.empty(elements), np.empty(pulleys)
    by_joint, direction = np.empty((elements, joints)), np.zeros((elements, 2))
    possible = shape(
        _read_only(plan),  # one type of argument, so that the kernel is compiled once
        _read_only(model.numbers),
        np.asarray(joint_angle, dtype=np.float64),
        length,
        by_joint,
        wrap,
        direction,
        np.empty((frames, geometry.POSE_NUMBERS)),
        np.empty((frames, joints, 3)),
    )
    return Shape(length, by_joint, wrap, direction, bool(possible))


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


def _pack(robot: Robot) -> Model:
    """All blocks of plan and numbers; material and routed references are filled in later."""
    motors = {motor.name: k for k, motor in enumerate(robot.motors)}
    joints = {joint.name: k for k, joint in enumerate(robot.joints)}
    frames = {frame.name: k for k, frame in enumerate(robot.frames)}

    cable_rows: list[list[int]] = []
    cable_numbers: list[list[float]] = []
    pulley_rows: list[list[int]] = []
    pulley_numbers: list[list[float]] = []
    losses: list[tuple[float, float]] = []
    halves: list[tuple[float, float]] = []
    spans: list[float] = []
    wraps: list[float] = []
    node_rows: list[list[int]] = []
    node_numbers: list[list[float]] = []
    terms: list[list[int]] = []
    tables: list[Vector] = []

    def add_profiles(profiles: tuple[Profile, ...], target: int, index: int) -> float:
        constant = 0.0
        for profile in profiles:
            if profile.joint is None:
                constant += float(profile.value[0])
                continue
            step = float(profile.angle[1] - profile.angle[0])
            terms.append([target, index, joints[profile.joint], len(tables)])
            tables.append(geometry.hermite_table(profile.value, profile.slope, step).ravel())
        return constant

    for cable in robot.cables:
        law = LAWS.index(cable.law)
        stribeck = _stribeck(cable)
        first, last = cable.nodes[0], cable.nodes[-1]
        cable_rows.append(
            [
                len(spans),
                len(cable.nodes) - 1,
                motors[first.motor] if isinstance(first, Winch) else -1,
                motors[last.motor] if isinstance(last, Winch) else -1,
                law,
                stribeck,
                int(cable.routed),
            ]
        )
        cable_numbers.append(
            [
                cable.axial_stiffness,
                cable.preload,
                cable.maximum_tension,
                *((first.radius, first.winding) if isinstance(first, Winch) else (0.0, 0.0)),
                *((last.radius, last.winding) if isinstance(last, Winch) else (0.0, 0.0)),
                cable.preload,
                cable.slack_tension,
            ]
        )
        for k, pulley in enumerate(cable.pulleys):
            row = _pulley_numbers(pulley, law)
            constant = add_profiles(pulley.wrap, packing.WRAP, len(wraps))
            moving = cable.routed or any(profile.joint for profile in pulley.wrap)
            pulley_rows.append([len(spans) + k, stribeck if moving else -1])
            losses.append(
                blended_loss(
                    row[cable_kernel.RHO],
                    row[cable_kernel.MU_C],
                    row[cable_kernel.MU_S],
                    constant,
                    row[cable_kernel.BEARING_RATIO],
                    stribeck,
                    row[cable_kernel.CELLS],
                )
            )
            halves.append((sin(0.5 * constant), cos(0.5 * constant)))
            wraps.append(constant)
            pulley_numbers.append(row)
        for profiles in cable.spans or ((),) * (len(cable.nodes) - 1):
            spans.append(add_profiles(profiles, packing.SPAN, len(spans)))
        for node in cable.nodes:
            place = node.place
            node_rows.append([frames[place.frame] if place else -1])
            node_numbers.append(
                [place.x, place.y, node.radius, place.turn, 0.0, pi] if place else [0.0] * 6
            )

    frame_rows = [
        [
            frames[frame.parent] if frame.parent else -1,
            geometry.MOTIONS.index(frame.motion),
            joints[frame.joint] if frame.joint else -1,
        ]
        for frame in robot.frames
    ]
    frame_numbers = [
        [frame.x, frame.y, frame.angle, *frame.direction, frame.rolling_radius]
        for frame in robot.frames
    ]
    motor_numbers = [[motor.reference_angle] for motor in robot.motors]
    joint_numbers = [
        [joint.lower, (joint.upper - joint.lower) / TABLE_INTERVALS] for joint in robot.joints
    ]
    axis_numbers = [[axis.effort_sign, *astuple(axis.passive)] for axis in robot.axes]

    header = np.zeros(packing.HEADER, dtype=np.int64)
    header[packing.MOTORS : packing.AT_CABLES] = [
        len(robot.motors),
        len(robot.joints),
        len(robot.cables),
        len(spans),
        len(wraps),
        len(robot.frames),
        len(terms),
    ]
    rows: list[NDArray[np.int64]] = [header]
    place_of_row = packing.AT_CABLES
    at = header.size
    for block in (cable_rows, pulley_rows, frame_rows, node_rows, terms):
        flat = np.array(block, dtype=np.int64).ravel()
        header[place_of_row] = at
        at += flat.size
        place_of_row += 1
        rows.append(flat)
    numbers: list[Vector] = []
    place_of_number = packing.IN_CABLES
    inside = 0
    blocks: tuple[Any, ...] = (
        cable_numbers,
        pulley_numbers,
        spans,
        np.zeros(len(spans)),
        wraps,
        losses,
        halves,
        frame_numbers,
        node_numbers,
        motor_numbers,
        joint_numbers,
        axis_numbers,
        np.concatenate(tables) if tables else [],
    )
    for numbers_block in blocks:
        values = np.array(numbers_block, dtype=np.float64).ravel()
        header[place_of_number] = inside
        inside += values.size
        place_of_number += 1
        numbers.append(values)
    plan = np.concatenate(rows)
    size = int(packing.state_size(plan))
    layout = _layout(robot)
    return Model(
        robot=robot,
        plan=plan,
        numbers=np.concatenate(numbers),
        layout=layout,
        state_size=size,
        out_size=size + layout.size + int(packing.scratch_size(plan)),
        state_part=slice(0, size),
        estimate_part=slice(size, size + layout.size),
    )


def _stribeck(cable: Cable) -> int:
    """Code of the cable's Stribeck form; its pulleys share one."""
    forms = {pulley.friction.stribeck for pulley in cable.pulleys} or {"printed"}
    return STRIBECK_FORMS.index(forms.pop())


def _pulley_numbers(pulley: Pulley, law: int) -> list[float]:
    """One row of pulley constants; the simpler laws are limits of the full one."""
    friction = pulley.friction
    if law == EULER:  # sliding alone, without static friction
        friction = replace(friction, rho=1.0, mu_s=friction.mu_c)
    rigid = law in (EULER, STEADY)
    cells = float(pulley.cells)  # parallel springs to the ground share stiffness and drag
    row = [0.0] * cable_kernel.PULLEY_COLUMNS
    row[cable_kernel.RADIUS] = pulley.radius
    row[cable_kernel.RHO] = friction.rho
    row[cable_kernel.MU_C] = friction.mu_c
    row[cable_kernel.MU_S] = friction.mu_s
    row[cable_kernel.STRIBECK_SPEED] = friction.stribeck_speed or NEVER_SLIDES
    row[cable_kernel.BEARING_RATIO] = _bearing_ratio(friction, pulley)
    row[cable_kernel.BRISTLE_STIFFNESS] = RIGID_BRISTLE if rigid else friction.bristle_stiffness
    row[cable_kernel.DRAG] = 0.0 if law == EULER else pulley.bearing_torque / pulley.radius
    row[cable_kernel.BRISTLE_DAMPING] = 0.0 if rigid else friction.bristle_damping
    row[cable_kernel.VISCOUS] = 0.0 if rigid else friction.viscous
    for shared in (
        cable_kernel.BRISTLE_STIFFNESS,
        cable_kernel.DRAG,
        cable_kernel.BRISTLE_DAMPING,
        cable_kernel.VISCOUS,
    ):
        row[shared] /= cells
    row[cable_kernel.STRIBECK_LAG] = friction.stribeck_lag
    row[cable_kernel.CELLS] = cells
    row[cable_kernel.BREAKAWAY] = 1.0 if rigid else friction.breakaway
    return row


def _bearing_ratio(friction: Friction, pulley: Pulley) -> float:
    """1 / alpha of (41)."""
    return friction.bearing_friction * pulley.bearing_diameter / pulley.radius


def _layout(robot: Robot) -> Layout:
    elements = tuple(name for cable in robot.cables for name in cable.element_names)
    pulleys = tuple(name for cable in robot.cables for name in cable.pulley_names)
    sizes = (
        [len(elements)] * 2
        + [len(pulleys)] * 5
        + [len(robot.motors), len(robot.joints)]
        + [len(robot.cables)] * 2
    )
    ends = np.cumsum([0, *sizes]).tolist()
    slices = [slice(a, b) for a, b in pairwise(ends)]
    return Layout(
        elements,
        pulleys,
        tuple(motor.name for motor in robot.motors),
        tuple(joint.name for joint in robot.joints),
        tuple(cable.name for cable in robot.cables),
        ends[-1],
        *slices,
    )


def _set_routed_references(model: Model, rest: Shape, reference: Vector) -> None:
    """Wraps about which pulleys are continuous, and the directions from which ends wind."""
    plan, numbers = model.plan, model.numbers
    pose = np.empty((int(plan[packing.FRAMES]), geometry.POSE_NUMBERS))
    twist = np.empty((pose.shape[0], reference.size, 3))
    if pose.size:
        at, inside = int(plan[packing.AT_FRAMES]), int(plan[packing.IN_FRAMES])
        count = pose.shape[0]
        geometry.place_frames(
            plan[at : at + 3 * count].reshape(count, 3),
            numbers[inside : inside + geometry.FRAME_NUMBERS * count].reshape(count, -1),
            reference,
            pose,
            twist,
        )
    node = element = pulley = 0
    for cable in model.robot.cables:
        count = len(cable.nodes)
        if cable.routed:
            for k in range(count):
                row = int(plan[packing.IN_NODES]) + (node + k) * geometry.NODE_NUMBERS
                frame = int(plan[int(plan[packing.AT_NODES]) + node + k])
                turn = numbers[row + geometry.TURN]
                if 0 < k < count - 1:
                    numbers[row + geometry.ARC_ANGLE] = rest.wrap[pulley + k - 1]
                    continue
                e = element if k == 0 else element + count - 2
                direction = np.arctan2(rest.direction[e, 1], rest.direction[e, 0])
                turned = pose[frame, geometry.POSE_ANGLE]
                numbers[row + geometry.ARC_REFERENCE] = direction
                numbers[row + geometry.ARC_ANGLE] = turn * (turned if k == 0 else -turned)
        node += count
        element += count - 1
        pulley += count - 2


def _check_range(model: Model) -> None:
    """The geometry must be possible everywhere in the joint ranges (sampled)."""
    joints = model.robot.joints
    if not joints:
        return
    share = np.linspace(0.0, 1.0, RANGE_CHECKS)
    if len(joints) == 1:
        shares = share[:, None]
    else:  # every joint alone about the reference, then all together along a dense path
        generator = np.random.default_rng(0)
        shares = generator.random((RANGE_CHECKS * len(joints), len(joints)))
        shares[0], shares[1] = 0.0, 1.0
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    for angle in lower + shares * (upper - lower):
        shape = shape_at(model, angle)
        if not shape.possible or not np.all(shape.length > 0.0) or not np.all(shape.wrap >= 0.0):
            raise RobotFileError(_impossible(model.robot, angle, shape))


def _number(model: Model, element: int) -> str:
    return model.layout.elements[element].split("/")[1]


def _impossible(robot: Robot, angle: Vector, shape: Shape) -> str:
    """One line that says which node of which cable cannot be, and at which joint angles."""
    pose = ", ".join(
        f"{joint.name} = {a:.4g}" for joint, a in zip(robot.joints, angle, strict=True)
    )
    where = f" at {pose}" if pose else ""
    element = pulley = 0
    for k, cable in enumerate(robot.cables):
        for e in range(len(cable.nodes) - 1):
            if cable.routed and not np.all(np.isfinite(shape.direction[element + e])):
                return (
                    f"cables[{k}].nodes[{e}] and nodes[{e + 1}] ({cable.name}) have no common "
                    f"tangent{where}: one circle lies inside the other, or both overlap where the "
                    f"cable should cross between them ({robot.source})"
                )
        for p in range(len(cable.nodes) - 2):
            wrap = shape.wrap[pulley + p]
            if not wrap >= 0.0:
                return (
                    f"cables[{k}].nodes[{p + 1}] ({cable.name}/{p + 2}) is left by its cable"
                    f"{where}: the wrap angle is {wrap:.4g} rad and must not be negative "
                    f"({robot.source})"
                )
        for e in range(len(cable.nodes) - 1):
            length = shape.length[element + e]
            if not length > 0.0:
                return (
                    f"cables[{k}]: element {cable.name}/{e + 1} has the length {length:.4g} m"
                    f"{where}; it must be positive ({robot.source})"
                )
        element += len(cable.nodes) - 1
        pulley += len(cable.nodes) - 2
    return f"the geometry is impossible{where} ({robot.source})"
