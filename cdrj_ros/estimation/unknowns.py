"""The unknowns of a robot: how its file's numbers may be off, and what has changed since.

A file has many uncertain numbers, but they move the tensions in few ways.  Let F have one column
per independent cause of error, F Fᵀ being the covariance of the file's numbers, and V one column
per cause with what a standard deviation of it changes in the tensions over the joints' ranges, as
shares of the preloads.  With the singular values of V = U D Wᵀ,

    numbers = file + F W x,     x ~ N(0, 1),                                             (B1)

the ``modes`` x are independent, and the few with D of at least ``LEAST`` stand for all numbers.

What may have changed since the file was written are preloads, zeros of joints and friction: one
unknown each, in units of a large change, most likely far smaller, and sometimes sudden.
See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.parameter_draws import independent_causes
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.laws import elasticity_of, tensions_at
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import Model, poses_in_range, prepare, segments_of, shape_at
from cdrj_ros.robot.description import Cable, Friction, Pulley, Robot, Uncertainty
from cdrj_ros.robot.parameters import writer_of
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import within_range

LEAST: Final = 0.02
"""Least change of the tensions by a mode, as a share of the preloads (RMS over poses)."""

POSES: Final = 24
"""Poses in which tensions are compared."""

SMALLEST_PRELOAD: Final = 1.0
"""Preload by which the changes of a cable with less are measured [N]."""


class Kind(NamedTuple):
    """How a number of the robot changes after its file was written."""

    unit: float
    """A large change: a share of a preload or a coefficient; of a zero [rad], [m] if it slides."""
    start: float
    """Standard deviation of the change at the start, in this unit."""
    drift: float
    """Random walk of the change after 1 s, in this unit."""
    jump: float
    """Standard deviation of a sudden change, in this unit."""


PRELOAD: Final = Kind(unit=0.2, start=0.25, drift=0.01, jump=1.0)
"""Cables settle by some percent after they are mounted, creep slowly, and slip at a clamp."""

ZERO: Final = Kind(unit=np.pi / 180.0, start=0.1, drift=0.0, jump=0.5)
"""An encoder keeps its zero within tenths of a degree, or slips on its shaft."""

ZERO_M: Final = ZERO._replace(unit=1e-3)
"""The same of a prismatic joint."""

FRICTION: Final = Kind(unit=0.25, start=0.2, drift=0.01, jump=0.0)
"""Coefficients rise and fall with wear, dust and oil."""


class Robots(NamedTuple):
    """A robot with one number changed to either side, and its angles less those that are read."""

    more: Model
    less: Model
    angle_more: Vector
    """[rad], of prismatic joints [m], shape (axes,)."""
    angle_less: Vector


@dataclass(frozen=True)
class Unknown:
    """One unknown of the estimate."""

    name: str
    """``preload of upper``; empty for a mode, which belongs to many numbers."""
    unit: float
    """Its size in SI, of which its value is a multiple; 1 for a mode."""
    start: float
    drift: float
    jump: float
    """As ``Kind``."""
    robots: Robots
    """The robot at plus and minus one unit."""


def unknowns_of(model: Model, known: Uncertainty | None) -> tuple[list[Unknown], Table]:
    """The unknowns of a robot, and the modes' numbers.

    Args:
        model: the prepared robot.
        known: standard deviations of its file's numbers; None: all are exact.

    Returns:
        Modes first, then changes; and F W of (B1), the change of every number in ``known`` per unit
        of every mode [SI], shape (numbers, modes).
    """
    if known is None or not known.parameters or not model.robot.document:
        return _changes(model), np.empty((0, 0))
    shapes = _modes(model, known)
    none = model, np.zeros(len(model.robot.axes))
    more, less = (_changed(model.robot, known, sign * shapes) for sign in (1.0, -1.0))
    found = []
    for ends in zip(more, less, strict=True):
        (up, shift_up), (down, shift_down) = (one or none for one in ends)
        robots = Robots(up, down, shift_up, shift_down)
        found.append(Unknown("", 1.0, 1.0, 0.0, 0.0, robots))
    return found + _changes(model), shapes


# --- modes of the file's numbers ------------------------------------------------------------------


def _modes(model: Model, known: Uncertainty) -> Table:
    """F W of (B1) for the modes of at least ``LEAST``."""
    causes = independent_causes(known)
    factor = np.zeros((len(known.parameters), len(causes)))
    for k, one in enumerate(causes):
        factor[one.numbers, k] = one.factor
    poses = _poses(model)
    without = _effects(model, np.zeros(len(model.robot.axes)), poses)
    effects = np.zeros((factor.shape[1], without.size))
    for k, changed in enumerate(_changed(model.robot, known, factor)):
        if changed is not None:
            effects[k] = _effects(*changed, poses) - without
    _, size, turn = np.linalg.svd(effects.T, full_matrices=False)
    return np.asarray(factor @ turn[size >= LEAST].T)


def _changed(
    robot: Robot, known: Uncertainty, changes: Table
) -> Iterator[tuple[Model, Vector] | None]:
    """The robot with other numbers, and its angles less those that are read [rad].

    None where no robot can have these numbers.

    Args:
        robot: the robot.
        known: with the paths of the numbers.
        changes: of them, one column per robot [SI], shape (numbers, robots).
    """
    given: Any = robot.document
    write = writer_of({**given, "uncertainty": {"others": "exact"}}, known.parameters)
    values = np.array(
        [within_range(given, path, by) for path, by in zip(known.parameters, changes, strict=True)]
    )
    for column in values.T.tolist():
        try:
            other = build_robot(write(column), robot.source)
            yield prepare(other, check_range=False), np.subtract(other.offsets, robot.offsets)
        except CdrjError:
            yield None


def _poses(model: Model) -> tuple[Table, Table]:
    """Poses in the joints' ranges, and angles of the motors that hold the preloads there."""
    robot = model.robot
    every = poses_in_range(robot)
    joints = every[np.linspace(0, len(every) - 1, min(POSES, len(every))).astype(int)]
    rest = shape_at(model, robot.reference_pose).length
    longer = np.array([shape_at(model, pose).length - rest for pose in joints])
    needed = np.stack([longer[:, part].sum(axis=1) for part in robot.parts])
    turned, *_ = np.linalg.lstsq(robot.drums, -needed, rcond=None)
    return joints, np.array([one.reference_angle for one in robot.motors]) + turned.T


def _effects(model: Model, angle: Vector, poses: tuple[Table, Table]) -> Vector:
    """What V of (B1) compares: tensions of all cables in all poses, and the losses of all pulleys.

    The tensions are those without friction, as shares of the preloads; below 0 they go on.

    Args:
        model: a robot.
        angle: its angles less those that are read [rad], shape (axes,).
        poses: readings of joints, shape (poses, joints), and of motors, shape (poses, motors).
    """
    robot, (joints, motors) = model.robot, poses
    views: Any = constant_views(model.sizes, model.constants)
    count = len(robot.motors)
    reference = np.array([motor.reference_angle for motor in robot.motors])
    wound = (motors + angle[:count] - reference) @ robot.drums.T
    length = np.array([shape_at(model, pose + angle[count:]).length for pose in joints])
    found = []
    for c, cable in enumerate(robot.cables):
        material = float(views.segments["material"][segments_of(model, c)].sum())
        strain = (length[:, robot.parts[c]].sum(axis=1) + wound[:, c]) / material - 1.0
        tension = tensions_at(elasticity_of(cable), strain)
        found.append(tension / (preload_of(cable) * np.sqrt(len(joints))))
    of_pulleys = np.repeat(
        [preload_of(cable) for cable in robot.cables], [len(one.pulleys) for one in robot.cables]
    )
    losses = views.pulleys["kinetic_loss"] + views.pulleys["drag"] / of_pulleys
    return np.concatenate([*found, losses])


# --- changes since the file was written -----------------------------------------------------------


def preload_of(cable: Cable) -> float:
    """The preload by which changes of a cable are measured [N]."""
    return max(cable.preload, SMALLEST_PRELOAD)


def _changes(model: Model) -> list[Unknown]:
    """Changes of preloads, zeros and friction, in this order."""
    robot = model.robot
    return [
        *(_preload(model, c) for c in range(len(robot.cables))),
        *(_zero(model, j) for j in range(len(robot.joints))),
        *(_friction(model, c) for c in range(len(robot.cables)) if _has_friction(robot.cables[c])),
    ]


def _has_friction(cable: Cable) -> bool:
    return any(pulley.friction.mu_c > 0.0 for pulley in cable.pulleys)


def _unknown(name: str, kind: Kind, size: float, robots: Robots) -> Unknown:
    return Unknown(name, kind.unit * size, kind.start, kind.drift, kind.jump, robots)


def _with_cable(model: Model, c: int, changed: Callable[[float], Cable]) -> Robots:
    """The robot with one cable changed by the share +1 and -1 of the unit."""
    cables, none = model.robot.cables, np.zeros(len(model.robot.axes))
    more, less = (
        prepare(
            replace(model.robot, cables=(*cables[:c], changed(sign), *cables[c + 1 :])),
            check_range=False,
        )
        for sign in (1.0, -1.0)
    )
    return Robots(more, less, none, none)


def _preload(model: Model, c: int) -> Unknown:
    cable = model.robot.cables[c]
    size = preload_of(cable)

    def changed(sign: float) -> Cable:
        return replace(cable, preload=max(cable.preload + sign * PRELOAD.unit * size, 0.0))

    return _unknown(f"preload of {cable.name}", PRELOAD, size, _with_cable(model, c, changed))


def _zero(model: Model, j: int) -> Unknown:
    robot = model.robot
    joint = robot.joints[j]
    kind = ZERO_M if joint.name in robot.prismatic_joints else ZERO
    shift = np.zeros(len(robot.axes))
    shift[len(robot.motors) + j] = kind.unit
    return _unknown(f"zero of joint {joint.name}", kind, 1.0, Robots(model, model, shift, -shift))


def _friction(model: Model, c: int) -> Unknown:
    cable = model.robot.cables[c]

    def changed(sign: float) -> Cable:
        factor = 1.0 + sign * FRICTION.unit

        def scaled(friction: Friction) -> Friction:
            return replace(friction, mu_c=factor * friction.mu_c, mu_s=factor * friction.mu_s)

        nodes = tuple(
            replace(node, friction=scaled(node.friction)) if isinstance(node, Pulley) else node
            for node in cable.nodes
        )
        return replace(cable, nodes=nodes)

    return _unknown(f"friction of {cable.name}", FRICTION, 1.0, _with_cable(model, c, changed))
