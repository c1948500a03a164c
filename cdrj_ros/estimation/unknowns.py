"""The unknowns of a robot: how its file's numbers may be off, and what has changed since.

A file has many uncertain numbers, but they move the tensions in few ways.  Let F have one column
per independent cause of error, F Fᵀ being the covariance of the file's numbers, and V one column
per cause with what a standard deviation of it changes in the tensions over the joints' ranges, as
shares of the preloads.  With the singular values of V = U D Wᵀ,

    numbers = file + F W x,     x ~ N(0, 1),                                             (B1)

the ``modes`` x are independent, and the few with D of at least ``LEAST`` stand for all numbers.
Causes that change one cable alone have modes of their own: one robot then shows what a mode of
every cable does.

What may have changed since the file was written are preloads, zeros of joints, friction, and
whether the drums hold: one unknown each, in units of a large change, most likely far smaller, and
sometimes sudden.
See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import NONLINEAR
from cdrj_ros.estimation.draws import independent_causes
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.laws import elasticity_of, tensions_at
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import Model, lengths_at, poses_in_range, prepare, segments_of
from cdrj_ros.robot.description import Cable, Pulley, Robot, Uncertainty, Winch
from cdrj_ros.robot.groups import Owners
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

    name: str
    unit: float
    """A large change: a share of a preload or a coefficient; of a zero [rad], [m] if it slides."""
    start: float
    """Standard deviation of the change at the start, in this unit."""
    drift: float = 0.0
    """Random walk of the change after 1 s, in this unit."""
    jump: float = 0.0
    """Standard deviation of a sudden change, in this unit."""
    reported: float = 1.0
    """Smallest change that is reported, in this unit."""
    error: float = NONLINEAR
    """Error of a correction by it, as a share of the correction."""


PRELOAD: Final = Kind("preload", unit=0.2, start=0.18, drift=0.01, jump=1.0, reported=0.25)
"""Cables settle by some percent after they are mounted, creep slowly, and slip at a clamp."""

ALIKE: Final = Kind("preloads", unit=0.2, start=0.18, drift=0.01)
"""What preloads have in common: creep of one rope, temperature, the gain of one spring scale.  An
effort that is a difference of cables hardly shows it."""

ZERO: Final = Kind("zero", unit=np.pi / 180.0, start=0.1, jump=0.5, reported=0.3)
"""An encoder keeps its zero within tenths of a degree, or slips on its shaft."""

ZERO_M: Final = ZERO._replace(unit=1e-3)
"""The same of a prismatic joint."""

FRICTION: Final = Kind("friction", unit=0.25, start=0.2, drift=0.01)
"""Coefficients rise and fall with wear, dust and oil."""

DRAG: Final = Kind("drag", unit=0.03, start=0.2, drift=0.01)
"""Bearings and seals turn harder with dust and old grease, whatever the load: a torque on every
pulley as a share of preload times radius, as ``DRAG`` of ``robot/tolerances.py``.
Verdicts call it friction."""

SLIP: Final = Kind("slip", unit=0.5, start=0.2, jump=2.0, reported=0.4, error=1.0)
"""A cable may slip on its drum, which then keeps no strain: a share of its cable, mostly none, at
times all.  Other errors of the model look alike to an effort, so the correction may be wholly
wrong."""


class Changed(NamedTuple):
    """A robot with other numbers."""

    model: Model
    angle: Vector
    """Its angles less those that are read [rad], of prismatic joints [m], shape (axes,)."""
    slipping: bool = False
    """Whether its cables slip on their drums."""


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
    error: float
    """As ``Kind``."""
    more: Changed
    less: Changed
    """The robot at plus and minus one unit."""
    cable: int | None = None
    """The only cable that it changes: the others of these robots show other unknowns; None where
    it changes several."""
    kind: Kind | None = None
    """Of a change; None for a mode."""


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
    shapes, cables = _modes(model, known)
    ends: dict[int, Changed] = {}
    both = np.concatenate([shapes, -shapes], axis=1)
    for some, changed in _changed(model.robot, known, both, 2 * cables):
        ends |= dict.fromkeys(some, changed or _same(model))
    found = [
        Unknown("", 1.0, 1.0, 0.0, 0.0, NONLINEAR, ends[k], ends[len(cables) + k], cable)
        for k, cable in enumerate(cables)
    ]
    return found + _changes(model), shapes


def _same(model: Model) -> Changed:
    return Changed(model, np.zeros(len(model.robot.axes)))


# --- modes of the file's numbers ------------------------------------------------------------------


def _modes(model: Model, known: Uncertainty) -> tuple[Table, list[int | None]]:
    """F W of (B1) for the modes of at least ``LEAST``, and the only cable that each changes."""
    causes = independent_causes(known)
    factor = np.zeros((len(known.parameters), len(causes)))
    for k, one in enumerate(causes):
        factor[one.numbers, k] = one.factor
    owners = Owners(model.robot, tuple((c,) for c in range(len(model.robot.cables))))
    cables = [owners.group_of_all(known.parameters[k] for k in one.numbers) for one in causes]
    poses = _poses(model)
    cable_of, without = _effects(_same(model), poses)
    effects = np.zeros((len(causes), without.size))
    for some, changed in _changed(model.robot, known, factor, cables):
        if changed is None:
            continue
        change = _effects(changed, poses)[1] - without
        for k in some:
            effects[k] = np.where((cables[k] is None) | (cable_of == cables[k]), change, 0.0)
    shapes, found = [np.empty((len(factor), 0))], list[int | None]()
    for cable in (*range(len(model.robot.cables)), None):
        own = [k for k, other in enumerate(cables) if other == cable]
        _, size, turn = np.linalg.svd(effects[own].T, full_matrices=False)
        shapes.append(factor[:, own] @ turn[size >= LEAST].T)
        found += [cable] * shapes[-1].shape[1]
    return np.concatenate(shapes, axis=1), found


def _changed(
    robot: Robot, known: Uncertainty, changes: Table, cables: Sequence[int | None]
) -> Iterator[tuple[list[int], Changed | None]]:
    """Robots with other numbers; changes of one cable each share a robot.

    Args:
        robot: the robot.
        known: with the paths of the numbers.
        changes: of them, shape (numbers, changes) [SI].
        cables: the only one that every change concerns; None for several.

    Yields:
        Indices of changes, and the robot with all of these; None where no robot can have them.
    """
    given: Any = robot.document
    write = writer_of({**given, "uncertainty": {"others": "exact"}}, known.parameters)
    together = _together(cables)
    shares = np.zeros((len(cables), len(together)))
    for r, some in enumerate(together):
        shares[some, r] = 1.0
    added = changes @ shares
    values = np.array(
        [within_range(given, path, by) for path, by in zip(known.parameters, added, strict=True)]
    )
    for some, column in zip(together, values.T.tolist(), strict=True):
        try:
            other = build_robot(write(column), robot.source)
            shift = np.subtract(other.offsets, robot.offsets)
            yield some, Changed(prepare(other, check_range=False), shift)
        except CdrjError:
            if len(some) == 1:
                yield some, None
                continue
            for k in some:  # most of them are possible alone
                for _, one in _changed(robot, known, changes[:, [k]], [None]):
                    yield [k], one


def _together(cables: Sequence[int | None]) -> list[list[int]]:
    """Indices of changes that may share a robot, for the only cable that each concerns."""
    alone: list[list[int]] = []
    of_cable: dict[int, list[int]] = {}
    for k, cable in enumerate(cables):
        if cable is None:
            alone.append([k])
        else:
            of_cable.setdefault(cable, []).append(k)
    together = zip_longest(*of_cable.values())
    return alone + [[k for k in some if k is not None] for some in together]


def _poses(model: Model) -> tuple[Table, Table]:
    """Poses in the joints' ranges, and angles of the motors that hold the preloads there."""
    robot = model.robot
    every = poses_in_range(robot)
    joints = every[np.linspace(0, len(every) - 1, min(POSES, len(every))).astype(int)]
    longer = lengths_at(model, joints) - lengths_at(model, robot.reference_pose[None])
    needed = np.stack([longer[:, part].sum(axis=1) for part in robot.parts])
    turned, *_ = np.linalg.lstsq(robot.drums, -needed, rcond=None)
    return joints, np.array([one.reference_angle for one in robot.motors]) + turned.T


def _effects(changed: Changed, poses: tuple[Table, Table]) -> tuple[NDArray[np.int64], Vector]:
    """What V of (B1) compares: tensions of all cables in all poses, and the losses of all pulleys.

    The tensions are those without friction, as shares of the preloads; below 0 they go on.

    Args:
        changed: a robot.
        poses: readings of joints, shape (poses, joints), and of motors, shape (poses, motors).

    Returns:
        The cable that each is of, and the numbers.
    """
    model, angle = changed.model, changed.angle
    robot, (joints, motors) = model.robot, poses
    views: Any = constant_views(model.sizes, model.constants)
    count = len(robot.motors)
    reference = np.array([motor.reference_angle for motor in robot.motors])
    wound = (motors + angle[:count] - reference) @ robot.drums.T
    length = lengths_at(model, joints + angle[count:])
    found = []
    for c, cable in enumerate(robot.cables):
        material = float(views.segments["material"][segments_of(model, c)].sum())
        strain = (length[:, robot.parts[c]].sum(axis=1) + wound[:, c]) / material - 1.0
        tension = tensions_at(elasticity_of(cable), strain)
        found.append(tension / (preload_of(cable) * np.sqrt(len(joints))))
    every = np.arange(len(robot.cables))
    of_pulleys = np.repeat(every, [len(one.pulleys) for one in robot.cables])
    preload = np.array([preload_of(cable) for cable in robot.cables])
    losses = views.pulleys["kinetic_loss"] + views.pulleys["drag"] / preload[of_pulleys]
    return (
        np.concatenate([np.repeat(every, len(joints)), of_pulleys]),
        np.concatenate([*found, losses]),
    )


# --- changes since the file was written -----------------------------------------------------------


def preload_of(cable: Cable) -> float:
    """The preload by which changes of a cable are measured [N]."""
    return max(cable.preload, SMALLEST_PRELOAD)


def _changes(model: Model) -> list[Unknown]:
    """Changes of preloads, zeros, friction, drag and slip, in this order."""
    robot, holding = model.robot, _same(model)
    more_preload, less_preload = (_with(model, _preloaded, sign) for sign in (1.0, -1.0))
    more_friction, less_friction = (_with(model, _rubbing, sign) for sign in (1.0, -1.0))
    dragging = _with(model, _dragging, 2.0)
    slipping = holding._replace(slipping=True)
    return [
        *(
            _unknown(f"preload of {cable.name}", PRELOAD, preload_of(cable), more_preload,
                     less_preload, c)
            for c, cable in enumerate(robot.cables)
        ),
        _unknown("preload of all cables", ALIKE, 1.0, more_preload, less_preload, None),
        *(_zero(model, j) for j in range(len(robot.joints))),
        *(
            _unknown(f"friction of {cable.name}", FRICTION, 1.0, more_friction, less_friction, c)
            for c, cable in enumerate(robot.cables)
            if any(pulley.friction.mu_c > 0.0 for pulley in cable.pulleys)
        ),
        *(
            _unknown(f"drag of {cable.name}", DRAG, 1.0, dragging, holding, c)
            for c, cable in enumerate(robot.cables)
            if any(pulley.radius > 0.0 for pulley in cable.pulleys)
        ),
        *(
            _unknown(f"slip of {cable.name} on its drum", SLIP, 1.0, slipping, holding, c)
            for c, cable in enumerate(robot.cables)
            if any(isinstance(node, Winch) for node in cable.nodes)
        ),
    ]  # fmt: skip


def _unknown(
    name: str, kind: Kind, size: float, more: Changed, less: Changed, cable: int | None
) -> Unknown:
    return Unknown(
        name, kind.unit * size, kind.start, kind.drift, kind.jump, kind.error, more, less, cable,
        kind,
    )  # fmt: skip


def _zero(model: Model, j: int) -> Unknown:
    robot = model.robot
    joint = robot.joints[j]
    kind = ZERO_M if joint.name in robot.prismatic_joints else ZERO
    shift = np.zeros(len(robot.axes))
    shift[len(robot.motors) + j] = kind.unit
    more, less = Changed(model, shift), Changed(model, -shift)
    return _unknown(f"zero of joint {joint.name}", kind, 1.0, more, less, None)


def _with(model: Model, changed: Callable[[Cable, float], Cable], units: float) -> Changed:
    """The robot with all cables changed by so many units."""
    cables = tuple(changed(cable, units) for cable in model.robot.cables)
    return _same(prepare(replace(model.robot, cables=cables), check_range=False))


def _preloaded(cable: Cable, units: float) -> Cable:
    """A cable with its preload changed."""
    changed = cable.preload + units * PRELOAD.unit * preload_of(cable)
    return replace(cable, preload=max(changed, 0.0))


def _rubbing(cable: Cable, units: float) -> Cable:
    """A cable with its coefficients of friction changed."""
    factor = 1.0 + units * FRICTION.unit

    def of(pulley: Pulley) -> Pulley:
        own = pulley.friction
        scaled = replace(own, mu_c=factor * own.mu_c, mu_s=factor * own.mu_s)
        return replace(pulley, friction=scaled)

    return _each_pulley(cable, of)


def _dragging(cable: Cable, units: float) -> Cable:
    """A cable whose pulleys turn harder, whatever it carries."""
    force = units * DRAG.unit * preload_of(cable)

    def of(pulley: Pulley) -> Pulley:
        return replace(pulley, bearing_torque=pulley.bearing_torque + force * pulley.radius)

    return _each_pulley(cable, of)


def _each_pulley(cable: Cable, changed: Callable[[Pulley], Pulley]) -> Cable:
    nodes = tuple(changed(node) if isinstance(node, Pulley) else node for node in cable.nodes)
    return replace(cable, nodes=nodes)
