"""Lengths, wraps, moment arms, losses and tensions of a robot's cables over the joint ranges.

``check_robot`` prints these values, which follow from geometry and statics alone.  The motors are
assumed to follow the joints such that every cable keeps its preload as well as the winches allow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import Stribeck, blended_loss
from cdrj_ros.foundation.arrays import Matrix, Table, Vector
from cdrj_ros.inspection.poses import visited_poses
from cdrj_ros.model.following import followed_by, stiffness_at_preload, whole_lengths
from cdrj_ros.model.laws import elasticity_of, friction_numbers, secant_at
from cdrj_ros.model.prepared import Course, Model, course_of, prepare
from cdrj_ros.robot.description import Cable, Robot, Winch, friction_law, turns_of
from cdrj_ros.robot.groups import connected_cables, joints_of


@dataclass(frozen=True)
class Extent:
    """Smallest and largest value over the poses, and the poses at which they occur."""

    low: float
    high: float
    low_at: tuple[float, ...]
    """Joint angles [rad], or [m] for prismatic joints."""
    high_at: tuple[float, ...]

    @property
    def width(self) -> float:
        """Largest less smallest value."""
        return self.high - self.low


@dataclass(frozen=True)
class ElementCheck:
    """One element of a cable over the joint ranges."""

    name: str
    length: Extent
    """Length of the element, including its share of the arcs [m]."""
    span: Extent
    """Length between the tangent points, including the arc wound on a drum or sector [m]."""
    moment_arm: tuple[Extent, ...]
    """-dL/dq of every joint [m]; [-] for prismatic joints."""


@dataclass(frozen=True)
class PulleyCheck:
    """One pulley of a cable over the joint ranges."""

    name: str
    wrap: Extent
    """Wrap angle [rad]."""
    transmission_at_rest: Extent
    """eta for v -> 0, the limit to be overcome before the cable slips [-]."""
    transmission_sliding: Extent
    """eta for v far above the Stribeck speed [-]."""
    passing: float
    """Length of cable that passes the pulley as the joints move through their ranges [m]."""
    needed: float
    """Length of cable after which it certainly slips: twice the break-away travel [m]."""


@dataclass(frozen=True)
class CableCheck:
    """One cable over the joint ranges."""

    name: str
    elements: tuple[ElementCheck, ...]
    pulleys: tuple[PulleyCheck, ...]
    length: Extent
    """Total length of all elements [m]."""
    moment_arm: tuple[Extent, ...]
    """-dL/dq of the total length for every joint [m]; [-] for prismatic joints."""
    transmission_at_rest: Extent
    """Product over the pulleys [-]."""
    transmission_sliding: Extent
    """Product over the pulleys [-]."""
    stiffness: float
    """dT / dL at the preload in the reference pose [N/m], EA / length of a linear cable."""
    followed: Extent
    """Frictionless tension while the motors follow [N]."""
    worst: Extent
    """Tension at the pulling end when every pulley has to slip [N]."""
    slack_after: tuple[float, ...]
    """Motion of every joint from the reference pose that removes all preload while the motors rest
    [rad] or [m]; infinite if the cable does not move the joint."""


@dataclass(frozen=True)
class MotorCheck:
    """One motor over the joint ranges."""

    name: str
    angle: Extent
    """Motor angle relative to the reference pose [rad]."""
    winding: tuple[float, ...]
    """Length of every cable that the motor winds in per radian [m]."""


@dataclass(frozen=True)
class Inspection:
    """A robot over its joint ranges."""

    model: Model
    poses: Matrix
    """Joint angles in which all joints move, shape (poses, joints)."""
    cables: tuple[CableCheck, ...]
    motors: tuple[MotorCheck, ...]
    unmoved: tuple[tuple[float, ...], ...]
    """Poses in which the joints can move without changing the length of any cable."""


RUN: Final = 100
"""Largest number of poses whose geometry is computed at once."""

LOOSEST: Final = 1e-7
"""Moment arms below this are treated as zero [m]."""


def inspect_robot(model: Model) -> Inspection:
    """Inspect a prepared robot in many poses of its joint ranges.

    Cables that share motors are inspected together, in poses of the joints that move them.

    Args:
        model: the robot.
    """
    robot = model.robot
    cables: dict[str, CableCheck] = {}
    motors: dict[str, Extent] = {}
    for group in connected_cables(robot, by_joints=False):
        own = tuple(robot.cables[c] for c in group)
        part = prepare(
            replace(robot, cables=own, residuals=(), uncertainty=None), check_range=False
        )
        moved = {name for cable in own for name in joints_of(robot, cable)}
        checks, angles = _inspected(part, visited_poses(robot, moved))
        cables |= {check.name: check for check in checks}
        wound = {name for cable in own for name in cable.motors}
        motors |= {name: angles[name] for name in wound}
    poses = _possible(model, visited_poses(robot, [joint.name for joint in robot.joints]))
    ranks = np.linalg.matrix_rank(_scaled(_total_arms(model, poses)))
    still = Extent(0.0, 0.0, tuple(robot.reference_pose), tuple(robot.reference_pose))
    radii = robot.effective_radii
    return Inspection(
        model,
        poses,
        tuple(cables[cable.name] for cable in robot.cables),
        tuple(
            MotorCheck(motor.name, motors.get(motor.name, still), tuple(radii[:, m].tolist()))
            for m, motor in enumerate(robot.motors)
        ),
        tuple(map(tuple, poses[ranks < len(robot.joints)].tolist())),
    )


def _possible(model: Model, poses: Matrix) -> Matrix:
    """All poses but the impossible ones."""
    kept, at = [], 0
    while at < len(poses):
        some = poses[at : at + RUN]
        done = course_of(model, some)[1]
        kept.append(some[:done])
        at += min(done + 1, len(some))
    return np.concatenate(kept)


def _total_arms(model: Model, poses: Matrix) -> Table:
    """Derivatives of every cable's length by every joint, shape (poses, cables, joints)."""
    starts = [part.start for part in model.robot.parts]
    return np.concatenate(
        [
            np.add.reduceat(course_of(model, poses[k : k + RUN])[0].lever_arm, starts, axis=1)
            for k in range(0, len(poses), RUN)
        ]
    )


def _inspected(model: Model, poses: Matrix) -> tuple[list[CableCheck], dict[str, Extent]]:
    """The cables of a robot in some poses, and the angles of its motors by name."""
    robot = model.robot
    poses = _possible(model, poses)
    course = course_of(model, poses)[0]
    whole = whole_lengths(robot, course.length)
    stiffness = stiffness_at_preload(robot, whole[0])
    motors, followed = followed_by(robot, whole)
    names = [motor.name for motor in robot.motors]
    angles = {name: _extent(motors[:, m], poses) for m, name in enumerate(names)}
    return list(_cables(model, poses, course, followed, stiffness, motors)), angles


def _cables(
    model: Model,
    poses: Matrix,
    course: Course,
    followed: Matrix,
    stiffness: Vector,
    motors: Matrix,
) -> Iterator[CableCheck]:
    robot = model.robot
    joints = range(len(robot.joints))
    pulley_at = 0
    for c, (cable, part) in enumerate(zip(robot.cables, robot.parts, strict=True)):
        length, by_joint = course.length[:, part], course.lever_arm[:, part]
        count = len(cable.pulleys)
        wrap = course.wrap[:, pulley_at : pulley_at + count]
        pulley_at += count
        eta = _transmissions(cable, wrap)
        arms = by_joint.sum(axis=1)
        secant = secant_at(elasticity_of(cable), cable.preload) / float(length[0].sum())
        yield CableCheck(
            cable.name,
            tuple(_elements(cable, poses, length, by_joint, wrap)),
            tuple(
                PulleyCheck(
                    name,
                    _extent(wrap[:, p], poses),
                    _extent(eta[:, p, 0], poses),
                    _extent(eta[:, p, 1], poses),
                    float(np.ptp(length[:, p + 1 :].sum(axis=1) + _wound(robot, cable, motors))),
                    _travel_to_slip(cable, p, eta[:, p, 0], followed[:, c]),
                )
                for p, name in enumerate(cable.pulley_names)
            ),
            _extent(length.sum(axis=1), poses),
            tuple(_extent(-arms[:, j], poses) for j in joints),
            _extent(eta[:, :, 0].prod(axis=1), poses),
            _extent(eta[:, :, 1].prod(axis=1), poses),
            float(stiffness[c]),
            _extent(followed[:, c], poses),
            _extent(_worst(cable, eta, followed[:, c]), poses),
            tuple(
                float(cable.preload / (secant * abs(arms[0, j])))
                if abs(arms[0, j]) > LOOSEST
                else float("inf")
                for j in joints
            ),
        )


def _elements(
    cable: Cable, poses: Matrix, length: Matrix, by_joint: NDArray[np.float64], wrap: Matrix
) -> Iterator[ElementCheck]:
    radius = np.array([pulley.radius for pulley in cable.pulleys])
    arcs = np.pad(0.5 * radius * wrap, ((0, 0), (1, 1)))
    spans = length - arcs[:, :-1] - arcs[:, 1:]
    for e, name in enumerate(cable.element_names):
        yield ElementCheck(
            name,
            _extent(length[:, e], poses),
            _extent(spans[:, e], poses),
            tuple(_extent(-by_joint[:, e, j], poses) for j in range(by_joint.shape[2])),
        )


def _transmissions(cable: Cable, wrap: Matrix) -> NDArray[np.float64]:
    """eta of every pulley at rest and sliding fast, by the cable's law: (37), (41), their blend.

    Args:
        cable: with the pulleys.
        wrap: their wrap angles [rad], shape (poses, pulleys).

    Returns:
        Shape (poses, pulleys, 2).
    """
    law = friction_law(cable.law)
    found = np.ones((*wrap.shape, 2))
    for p, pulley in enumerate(cable.pulleys if law.sliding else ()):
        one = friction_numbers(pulley, law)
        rho, mu_c, mu_s, bearing = (one[key] for key in ("rho", "mu_c", "mu_s", "bearing_ratio"))
        stribeck = Stribeck[pulley.friction.stribeck]
        for k, angle in enumerate(wrap[:, p].tolist()):
            kinetic, static = blended_loss(rho, mu_c, mu_s, angle, bearing, stribeck)
            found[k, p] = 1.0 - kinetic - static, 1.0 - kinetic
    return found


def _wound(robot: Robot, cable: Cable, motors: Matrix) -> Vector:
    """Cable length wound in by the drum at the last node [m], shape (poses,); 0 for an anchor."""
    last = cable.nodes[-1]
    if not isinstance(last, Winch):
        return np.zeros(motors.shape[0])
    names = [motor.name for motor in robot.motors]
    windings = turns_of(last)
    wound: Vector = motors[:, [names.index(name) for name in windings]] @ [*windings.values()]
    return last.effective_radius * wound


def _worst(cable: Cable, eta: NDArray[np.float64], followed: Vector) -> Vector:
    """Tension at node 1 when every pulley has to slip towards it [N], shape (poses,)."""
    worst = followed
    for p in reversed(range(len(cable.pulleys))):  # each pulley adds its loss
        drag = friction_numbers(cable.pulleys[p], friction_law(cable.law))["drag"]
        worst = worst / eta[:, p, 0] + np.where(worst > 0.0, drag, 0.0)
    return worst


def _travel_to_slip(cable: Cable, p: int, eta: Vector, tension: Vector) -> float:
    """Travel from one friction bound to the other: 2 g / sigma0 with g = (1 - eta) T [m]."""
    law = friction_law(cable.law)
    if not law.sliding:
        return 0.0
    stiffness = friction_numbers(cable.pulleys[p], law)["bristle_stiffness"]
    return float(np.max(2.0 * (1.0 - eta) * tension)) / stiffness


def _extent(values: Vector, poses: Matrix) -> Extent:
    low, high = int(np.argmin(values)), int(np.argmax(values))
    return Extent(
        float(values[low]), float(values[high]), tuple(poses[low].tolist()),
        tuple(poses[high].tolist()),
    )  # fmt: skip


def _scaled(arms: Table) -> Table:
    """Moment arms with columns of unit norm, so that their units do not affect the rank."""
    norm = np.linalg.norm(arms, axis=-2, keepdims=True)
    scaled: Table = arms / np.where(norm > LOOSEST, norm, np.inf)
    return scaled
