"""The unknowns of a robot: how its file's numbers may be off, and what has changed since.

A file has many uncertain numbers, but they move the tensions in few ways.  Let F have one column
per independent cause of error, F Fᵀ being the covariance of the file's numbers, and V one column
per cause with what a standard deviation of it changes in the tensions on a walk through the joints'
ranges, as shares of the preloads.  With the singular values of V = U D Wᵀ,

    numbers = file + F W x,     x ~ N(0, 1),                                             (B1)

the ``modes`` x are independent, and the few with D of at least ``LEAST`` stand for all numbers.
Causes that change one cable alone have modes of their own: one robot then shows what a mode of
every cable does.

What may have changed since the file was written are the rows of ``KINDS``, in units of a large
change, most likely far smaller, and sometimes sudden.  See docs/estimation.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from math import degrees, inf, radians
from typing import Any, Final, NamedTuple

import numpy as np

from cdrj_ros import _core
from cdrj_ros._core import NONLINEAR
from cdrj_ros.estimation.draws import independent_causes
from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.following import following_motors
from cdrj_ros.model.laws import with_pulleys
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import Model, poses_in_range, prepare, shape_at
from cdrj_ros.robot.axes import DEFAULT_BREAKAWAY_ANGLE
from cdrj_ros.robot.description import Cable, PassiveTorque, Pulley, Robot, Uncertainty, Winch
from cdrj_ros.robot.groups import Owners
from cdrj_ros.robot.parameters import Number, find_number, writer_of
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import within_range

LEAST: Final = 0.03
"""Least change of the tensions by a mode, as a share of the preloads (RMS over poses)."""

POSES: Final = 24
"""Poses in which tensions are compared."""

SMALL: Final = 0.01
"""Part of a standard deviation that is compared there: more would make cables slack."""

SMALLEST_PRELOAD: Final = 1.0
"""Preload by which the changes of a cable with less are measured [N]."""


class Kind(NamedTuple):
    """How a number of the robot is off, or changes after its file was written."""

    name: str
    what: str
    """Name of such an unknown, with the name of its cable or axis for ``{}``."""
    unit: float
    """A large change: a share of a preload or coefficient, or of what the preloads contribute to an
    effort; of a zero [rad], [m] if it slides."""
    start: float = 0.0
    """Standard deviation of the change at the start, in this unit."""
    drift: float = 0.0
    """Random walk of the change after 1 s, in this unit."""
    jump: float = 0.0
    """Standard deviation of a sudden change, in this unit."""
    reported: float = 0.0
    """Smallest change that is reported, in this unit; 0 for none."""
    words: tuple[str, float] = ("%", 100.0)
    """Unit in which it is reported, and its amount per unit of SI."""
    alike: str = ""
    """Name of the same change of all cables, which is reported as one; empty for none."""
    lowest: float = -inf
    """Smallest change that is possible, in this unit."""
    error: float = NONLINEAR
    """Error of a correction by it, as a share of the correction."""
    said: tuple[str, str] = (
        "{what} is {size} more than in the robot file",
        "{what} is {size} less than in the robot file",
    )
    """How a positive change, and a negative one, is reported."""


MODE: Final = Kind("mode", "", 1.0, start=1.0)
"""What the file leaves open moves the tensions along with it, (B1)."""

PRELOAD: Final = Kind(
    "preload", "preload of {}", 0.2, start=0.18, drift=0.01, jump=1.0, reported=0.25,
    words=("N", 1.0), alike="preload of all cables", lowest=-5.0,
    said=("{what} has risen by {size}", "{what} has lost {size}"),
)  # fmt: skip
"""Cables settle by some percent after they are mounted, creep slowly, and slip at a clamp."""

ALIKE: Final = PRELOAD._replace(
    name="preloads", what="preload of all cables", reported=0.0, alike=""
)
"""What preloads have in common: creep of one rope, temperature, the gain of one spring scale.  An
effort that is a difference of cables hardly shows it."""

ZERO: Final = Kind(
    "zero", "zero of joint {}", radians(1.0), start=0.1, jump=0.5, reported=0.3,
    words=("deg", degrees(1.0)),
    said=(
        "{what} is off: it reads {size} too little; ~/tare",
        "{what} is off: it reads {size} too much; ~/tare",
    ),
)  # fmt: skip
"""An encoder keeps its zero within tenths of a degree, or slips on its shaft."""

ZERO_M: Final = ZERO._replace(unit=1e-3, words=("mm", 1e3))
"""The same of a prismatic joint."""

FRICTION: Final = Kind(
    "friction", "friction of {}", 0.25, start=0.2, drift=0.01, reported=1.0,
    alike="friction of all cables", lowest=-4.0,
)  # fmt: skip
"""Coefficients rise and fall with wear, dust and oil."""

DRAG: Final = Kind("drag", "drag of {}", 0.03, start=0.2, drift=0.01)
"""Bearings and seals turn harder with dust and old grease, whatever the load: a torque on every
pulley as a share of preload times radius, as ``DRAG`` of ``robot/tolerances.py``.
Verdicts call it friction."""

SLIP: Final = Kind(
    "slip", "slip of {} on its drum", 0.5, start=0.2, jump=2.0, reported=0.4, error=1.0,
    alike="slip of all cables", lowest=0.0,
    said=("{what}: {size} of what is wound keeps no strain",) * 2,
)  # fmt: skip
"""A cable may slip on its drum, which then keeps no strain: a share of its cable, mostly none, at
times all.  Other errors of the model look alike to an effort, so the correction may be wholly
wrong."""

AXIS: Final = Kind(
    "axis friction", "friction of the axis {}", 0.1, start=1.0, reported=0.3, words=("N m", 1.0)
)
"""Friction of a motor with its gear, or of a joint, of which files say little."""

FRICTION_KNOWN: Final = 0.3
"""Standard deviation of an axis' friction as a share of what the robot file states."""

COUNTS: Final = 2.0
"""The friction of an axis follows it after a turn by as many counts of its encoder at least."""


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

    kind: Kind
    name: str
    """``preload of upper``; empty for a mode, which belongs to many numbers."""
    unit: float
    """Its size in SI, of which its value is a multiple; 1 for a mode."""
    more: Changed
    less: Changed
    """The robot at plus and minus one unit."""
    only: int = -1
    """The only cable that it changes, or the only axis, counted after the cables: the others of
    these robots show other unknowns; -1 where it changes several."""
    path: str = ""
    """Of the number of the robot file that it changes; empty for several."""


def unknowns_of(model: Model, known: Uncertainty | None) -> tuple[list[Unknown], Table]:
    """The unknowns of a robot, and the modes' numbers.

    Args:
        model: the prepared robot.
        known: standard deviations of its file's numbers; None: all are exact.

    Returns:
        Modes first, then changes; and F W of (B1), the change of every number in ``known`` per unit
        of every mode [SI], shape (numbers, modes).
    """
    changes = list(_changes(model, known))
    if known is None or not known.parameters or not model.robot.document:
        return changes, np.empty((0, 0))
    given: Any = model.robot.document
    numbers = [find_number(given, path) for path in known.parameters]
    shapes, only = _modes(model, known, numbers)
    more = _ends(model, numbers, shapes, only)
    less = _ends(model, numbers, -shapes, only)
    modes = [Unknown(MODE, "", 1.0, *ends) for ends in zip(more, less, only, strict=True)]
    return modes + changes, shapes


def signatures_of(model: Model, unknowns: Sequence[Unknown]) -> _core.Signatures:
    """The robots at plus and minus one unit of every unknown, before their first step."""
    ends = {id(end): end for one in unknowns for end in (one.more, one.less)}
    number = {end: k for k, end in enumerate(ends)}
    rows = [(number[id(one.more)], number[id(one.less)], one.only) for one in unknowns]
    constants = np.stack([end.model.constants for end in ends.values()])
    residuals: Any = constant_views(model.sizes, constants).residuals
    residuals["bound"] = 0.0  # the estimate alone is corrected by what its file has learned
    return _core.Signatures(
        model.core, constants, np.stack([end.angle for end in ends.values()]),
        np.array([end.slipping for end in ends.values()]), np.array(rows, np.int64),
    )  # fmt: skip


def _same(model: Model) -> Changed:
    return Changed(model, np.zeros(len(model.robot.axes)))


# --- modes of the file's numbers ------------------------------------------------------------------


def _modes(model: Model, known: Uncertainty, numbers: Sequence[Number]) -> tuple[Table, list[int]]:
    """F W of (B1) for the modes of at least ``LEAST``, and the only cable that each changes."""
    causes = independent_causes(known)
    factor = np.zeros((len(known.parameters), len(causes)))
    for k, one in enumerate(causes):
        factor[one.numbers, k] = one.factor
    every = range(len(model.robot.cables))
    owners = Owners(model.robot, tuple((c,) for c in every))
    cables = [owners.group_of_all(known.parameters[k] for k in one.numbers) for one in causes]
    only = [-1 if c is None else c for c in cables]
    effects = _effects(model, _ends(model, numbers, SMALL * factor, only), only) / SMALL
    shapes, found = [np.empty((len(factor), 0))], list[int]()
    for cable in (*every, -1):
        own = [k for k, other in enumerate(only) if other == cable]
        squares, turn = np.linalg.eigh(effects[own] @ effects[own].T)
        shapes.append(factor[:, own] @ turn[:, squares >= LEAST**2])
        found += [cable] * shapes[-1].shape[1]
    return np.concatenate(shapes, axis=1), found


def _ends(
    model: Model, uncertain: Sequence[Number], changes: Table, only: Sequence[int]
) -> list[Changed]:
    """Robots with other numbers; changes of one cable each share a robot.

    Args:
        model: the robot.
        uncertain: its file's numbers.
        changes: of them, shape (numbers, changes) [SI].
        only: the only cable that every change concerns; -1 for several.

    Returns:
        One for every change; the unchanged one where no robot can have it.
    """
    given: Any = model.robot.document
    write = writer_of({**given, "uncertainty": {"others": "exact"}}, uncertain)

    together, same = _together(only), _same(model)
    added = np.array([changes[:, some].sum(axis=1) for some in together]).reshape(-1, len(changes))
    values = [within_range(given, *one) for one in zip(uncertain, added.T, strict=True)]
    found = [same] * len(only)
    for some, numbers in zip(together, np.array(values).T.tolist(), strict=True):
        try:
            other = build_robot(write(numbers), model.robot.source)
            shift = np.subtract(other.offsets, model.robot.offsets)
            ends = [Changed(prepare(other, check_range=False), shift)] * len(some)
        except CdrjError:  # most of them are possible alone
            alone = len(some) > 1
            ends = _ends(model, uncertain, changes[:, some], [-1] * len(some)) if alone else [same]
        for k, end in zip(some, ends, strict=True):
            found[k] = end
    return found


def _together(only: Sequence[int]) -> list[list[int]]:
    """Indices of changes that may share a robot, for the only cable that each concerns."""
    own = [[k for k, c in enumerate(only) if c == cable] for cable in set(only) - {-1}]
    shared = [[k for k in some if k is not None] for some in zip_longest(*own)]
    return [[k] for k, c in enumerate(only) if c < 0] + shared


def _effects(model: Model, ends: Sequence[Changed], only: Sequence[int]) -> Table:
    """V of (B1), by causes: what each changes in all tensions on a walk through the ranges.

    Motors turn so that every cable keeps its preload without friction.
    """
    robot, same = model.robot, _same(model)
    causes = [Unknown(MODE, "", 1.0, end, same, c) for end, c in zip(ends, only, strict=True)]
    every = poses_in_range(robot)
    joints = every[np.linspace(0, len(every) - 1, min(POSES, len(every))).astype(int)]
    motors = following_motors(model, joints)
    signatures = signatures_of(model, causes)
    tensions = slice(robot.parts[-1].stop)
    walked = [
        signatures.follow(motor, joint, 1.0)[:, tensions]
        for motor, joint in zip(motors, joints, strict=True)
    ]
    preload = robot.per_element([preload_of(cable) for cable in robot.cables])
    elements = robot.per_element([part.stop - part.start for part in robot.parts])
    scale = preload * np.sqrt(elements * len(joints))
    return np.asarray(2.0 * np.concatenate([one / scale for one in walked], axis=1))


# --- changes since the file was written -----------------------------------------------------------


def preload_of(cable: Cable) -> float:
    """The preload by which changes of a cable are measured [N]."""
    return max(cable.preload, SMALLEST_PRELOAD)


def efforts_of_preloads(model: Model) -> Table:
    """What the preload of every cable contributes to every effort, without signs [N m], or [N].

    Shape (cables, axes).
    """
    robot = model.robot
    arms = np.abs(shape_at(model, robot.reference_pose).lever_arm)
    of_joints = [arms[part].max(axis=0, initial=0.0) for part in robot.parts]
    preload = np.array([preload_of(cable) for cable in robot.cables])
    joints = np.array(of_joints).reshape(len(robot.cables), -1)
    return np.asarray(preload[:, None] * np.hstack([np.abs(robot.effective_radii), joints]))


def _changes(model: Model, known: Uncertainty | None) -> Iterator[Unknown]:
    """What may have changed of every cable, of all, of every joint and of every axis."""
    robot, same = model.robot, _same(model)

    def made(changed: Robot) -> Changed:
        return _same(prepare(changed, check_range=False))

    def with_preloads(units: float) -> Changed:
        more = [units * PRELOAD.unit * preload_of(cable) for cable in robot.cables]
        pairs = zip(robot.cables, more, strict=True)
        cables = (replace(one, preload=max(one.preload + by, 0.0)) for one, by in pairs)
        return made(replace(robot, cables=tuple(cables)))

    def rubs(factor: float, _cable: Cable, pulley: Pulley, _: int) -> Pulley:
        own = pulley.friction
        scaled = replace(own, mu_c=factor * own.mu_c, mu_s=factor * own.mu_s)
        return replace(pulley, friction=scaled)

    def drags(cable: Cable, pulley: Pulley, _: int) -> Pulley:
        torque = 2.0 * DRAG.unit * preload_of(cable) * pulley.radius
        return replace(pulley, bearing_torque=pulley.bearing_torque + torque)

    preloads = with_preloads(1.0), with_preloads(-1.0)
    rough, smooth = (partial(rubs, 1.0 + units * FRICTION.unit) for units in (1.0, -1.0))
    rubbing = made(with_pulleys(robot, rough)), made(with_pulleys(robot, smooth))
    dragging = made(with_pulleys(robot, drags)), same
    slipping = same._replace(slipping=True), same
    yield _unknown(ALIKE, "", *preloads)
    for c, cable in enumerate(robot.cables):
        path = f"cables.{cable.name}.preload"
        yield _unknown(PRELOAD, cable.name, *preloads, c, preload_of(cable), path)
        pulleys = [node for node in cable.nodes if isinstance(node, Pulley)]
        if any(pulley.friction.mu_c > 0.0 for pulley in pulleys):
            yield _unknown(FRICTION, cable.name, *rubbing, c)
        if any(pulley.radius > 0.0 for pulley in pulleys):
            yield _unknown(DRAG, cable.name, *dragging, c)
        if any(isinstance(node, Winch) for node in cable.nodes):
            yield _unknown(SLIP, cable.name, *slipping, c)
    for j, joint in enumerate(robot.joints):
        kind = ZERO_M if joint.name in robot.prismatic_joints else ZERO
        shift = np.zeros(len(robot.axes))
        shift[len(robot.motors) + j] = kind.unit
        ends = Changed(model, shift), Changed(model, -shift)
        yield _unknown(kind, joint.name, *ends, path=f"joints.{joint.name}.reference_angle")
    yield from _of_axes(model, known)


def _unknown(
    kind: Kind,
    name: str,
    more: Changed,
    less: Changed,
    only: int = -1,
    size: float = 1.0,
    path: str = "",
) -> Unknown:
    return Unknown(kind, kind.what.format(name), kind.unit * size, more, less, only, path)


def _of_axes(model: Model, known: Uncertainty | None) -> Iterator[Unknown]:
    """Friction of the axes whose efforts may be read.

    It reverses within a milliradian, or two counts, that of the cables only after the cable has
    given up its elongation and its contacts have slipped back: so an effort tells them apart.
    """
    robot, same, scales = model.robot, _same(model), efforts_of_preloads(model).sum(axis=0)
    stated = known.stddev if known is not None else {}
    stated = {path: stated[path] for path in list(stated)[: known.stated if known else 0]}

    def rubbing(k: int) -> PassiveTorque:
        axis = robot.axes[k]
        own, counts = axis.passive, abs(axis.sensor.scale) * axis.sensor.resolution
        slope = own.bearing_stiffness or own.bearing_torque / DEFAULT_BREAKAWAY_ANGLE
        breakaway = own.bearing_torque / slope if slope else DEFAULT_BREAKAWAY_ANGLE
        torque = own.bearing_torque + 2.0 * AXIS.unit * scales[k]
        stiffness = torque / max(breakaway, COUNTS * counts)
        return replace(own, bearing_torque=torque, bearing_stiffness=stiffness)

    count = len(robot.motors)
    motors = (replace(one, passive=rubbing(k)) for k, one in enumerate(robot.motors))
    joints = (replace(one, passive=rubbing(count + k)) for k, one in enumerate(robot.joints))
    changed = replace(robot, motors=tuple(motors), joints=tuple(joints))
    more = _same(prepare(changed, check_range=False))
    for a, axis in enumerate(robot.axes):
        if axis.effort_noise is None or not scales[a]:
            continue
        path = f"{'motors' if a < count else 'joints'}.{axis.name}.bearing_torque"
        size = np.hypot(AXIS.unit * scales[a], FRICTION_KNOWN * axis.passive.bearing_torque)
        scale, stated_size = float(scales[a]), axis.passive.bearing_torque
        unit = AXIS.unit * scale
        kind = AXIS._replace(start=float(stated.get(path, size)) / unit, lowest=-stated_size / unit)
        yield _unknown(kind, axis.name, more, same, len(robot.cables) + a, scale)
