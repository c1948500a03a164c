"""Faults of the rig: a drum slips on its shaft, an anchor yields, an encoder repeats itself.

A fault is an object with ``apply(times, values)``.  Those of cables turn the moving end of
the cable, which no encoder measures: it is driven by an additional motor.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.laws import elasticity_of, secant_at, strain_at
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.description import Anchor, Cable, Motor, Node, Robot, Winch
from cdrj_ros.simulation.motion import smooth_step

ANCHOR_RADIUS: Final = 0.01
"""Radius of the drum that represents a yielding anchor [m]; its value is arbitrary."""


@dataclass(frozen=True)
class CableFault:
    """A fault at one end of one cable."""

    begin: float
    """Start of the fault on the truth's clock [s]."""
    amount: float | None = None
    """Length of cable [m] or, at a winch, angle of the drum [rad]; None for the default."""
    cable: str | None = None
    """Name of the cable; None for the robot's first cable."""

    kind: ClassVar[str]
    end: ClassVar[type[Anchor] | type[Winch]] = Anchor
    """Which end of the cable moves."""
    duration_s: ClassVar[float]
    usual_share: ClassVar[float] = 0.5
    """Share of the elongation under preload that the fault removes if no amount is given."""
    largest: ClassVar[float] = 1.0
    """Largest amount [m] or [rad]."""

    def __post_init__(self) -> None:
        """Refuse an impossible amount."""
        if self.amount is not None and not 0.0 < self.amount <= self.largest:
            raise UsageError(
                f"the amount of {self.kind} must be in (0, {self.largest:g}], got {self.amount:g}"
            )

    def apply(self, times: Vector, values: Vector) -> Vector:
        """Rotation of the end [rad], shape (n,), of its rotation after the fault, ``values``."""
        return values * smooth_step((times - self.begin) / self.duration_s)

    def during(self, times: Vector) -> NDArray[np.bool_]:
        """Whether the fault is in progress, shape (n,)."""
        return (times >= self.begin) & (times <= self.begin + self.duration_s)

    def __str__(self) -> str:
        return f"{self.kind} of {self.cable or 'the first cable'}"


class Slack(CableFault):
    """The anchor creeps until hardly any preload is left in the cable and in those on its motor."""

    kind = "slack"
    duration_s = 2.0
    usual_share = 0.9


class Snap(CableFault):
    """The anchor suddenly yields by half of the cable's own elongation under preload."""

    kind = "snap"
    duration_s = 0.002


class Slip(CableFault):
    """For a while the drum turns less than its encoder, by the same length of cable as a snap."""

    kind = "slip"
    end = Winch
    duration_s = 0.5
    largest = 100.0


@dataclass(frozen=True)
class EncoderFault(ABC):
    """A fault of the readings of one encoder."""

    begin: float
    """Start of the fault [s]."""
    encoder: str
    """Motor or joint."""

    kind: ClassVar[str]

    @abstractmethod
    def apply(self, times: Vector, values: Vector) -> Vector:
        """Readings, of which the first has been sent before; all arrays of shape (n,)."""

    def __str__(self) -> str:
        return f"{self.kind} of {self.encoder}"


class Freeze(EncoderFault):
    """The encoder repeats its last reading."""

    kind = "freeze"

    def apply(self, times: Vector, values: Vector) -> Vector:
        """Readings, the last before the fault in place of all later ones."""
        first = max(int(np.searchsorted(times, self.begin)), 1)
        return np.concatenate([values[:first], np.full(times.size - first, values[first - 1])])


Fault = CableFault | EncoderFault

KINDS: Final[Mapping[str, type[Fault]]] = {one.kind: one for one in (Slack, Snap, Slip, Freeze)}
"""All faults, by their names in a rig file."""


def fault_of(entry: Mapping[str, Any], path: str) -> Fault:
    """The fault that an entry of a rig file describes; ``path`` is named in errors.

    Raises:
        UsageError: a key does not suit the kind, or an impossible amount.
    """
    kind = KINDS[entry["kind"]]
    known = {one.name: one.default is MISSING for one in fields(kind) if one.name != "begin"}
    given = {key: value for key, value in entry.items() if key not in ("kind", "at")}
    if set(given) - set(known) or {key for key, needed in known.items() if needed} - set(given):
        raise UsageError(
            f"{path}: {kind.kind} takes {' and '.join(known)}, got {', '.join(given) or 'neither'}"
        )
    return kind(float(entry["at"]), **given)


@dataclass(frozen=True)
class Wiring:
    """A robot with an additional motor for every faulty end."""

    robot: Robot
    """The robot; its first motors are those of the robot without faults."""
    faults: tuple[tuple[CableFault, int, float], ...]
    """Each fault with the index of the motor that it moves and the rotation in all [rad]."""

    def offset(self, time: Vector) -> NDArray[np.float64]:
        """Angles by which faults turn the motors [rad], shape (n, all motors)."""
        offset = np.zeros((time.size, len(self.robot.motors)))
        for fault, motor, turn in self.faults:
            offset[:, motor] += fault.apply(time, np.full(time.size, turn))
        return offset

    def during(self, time: Vector) -> NDArray[np.bool_]:
        """Whether a fault is in progress, shape (n,)."""
        happening = np.zeros(time.shape, dtype=np.bool_)
        for fault, _, _ in self.faults:
            happening |= fault.during(time)
        return happening


def wire(robot: Robot, faults: tuple[CableFault, ...]) -> Wiring:
    """Add a motor for every cable end that the faults move.

    Raises:
        UsageError: a cable does not exist, has no such end, or needs an amount.
    """
    motors, cables = list(robot.motors), list(robot.cables)
    moved: list[tuple[CableFault, int, float]] = []
    taken: dict[tuple[int, int], int] = {}
    for fault in faults:
        index = _cable_of(robot, fault)
        cable = robot.cables[index]
        place, radius, winding = _end(cable, fault)
        if (index, place) not in taken:
            taken[index, place] = len(motors)
            node = cable.nodes[place]
            extra = Motor(f"{cable.name}_{'drum' if isinstance(node, Winch) else 'anchor'}")
            motors.append(extra)
            turned = node.motors if isinstance(node, Winch) else ()
            nodes = list(cables[index].nodes)
            nodes[place] = Winch((*turned, (extra.name, 1.0)), radius, winding, node.place)
            cables[index] = replace(cables[index], nodes=tuple(nodes))
        turn = -winding * _turn(robot, fault, index, radius)
        moved.append((fault, taken[index, place], turn))
    wired = replace(robot, motors=tuple(motors), cables=tuple(cables)) if faults else robot
    return Wiring(wired, tuple(moved))


def _turn(robot: Robot, fault: CableFault, index: int, radius: float) -> float:
    """Angle by which the drum of a faulty end gives way in all [rad]."""
    cable = robot.cables[index]
    stretch = 1.0 + strain_at(elasticity_of(cable), cable.preload)
    if fault.amount is not None:
        return fault.amount if fault.end is Winch else fault.amount * stretch / radius
    together = [index]
    if isinstance(fault, Slack):  # of all cables on the same motors
        others = (c for c, one in enumerate(robot.cables) if {*one.motors} & {*cable.motors})
        together += [c for c in others if c != index]
    paid_out = fault.usual_share * sum(_elongation(robot, c) for c in together)
    if not paid_out > 0.0:
        raise UsageError(
            f"fault {fault.kind} of {cable.name} needs an amount: without preload there is none to "
            "lose"
        )
    return paid_out * stretch / radius


def _cable_of(robot: Robot, fault: CableFault) -> int:
    names = [cable.name for cable in robot.cables]
    if fault.cable is None:
        return 0
    if fault.cable not in names:
        raise UsageError(
            f"fault {fault.kind} names the cable {fault.cable}; there are {', '.join(names)}"
        )
    return names.index(fault.cable)


def _end(cable: Cable, fault: CableFault) -> tuple[int, float, int]:
    """Index of the moving node, radius of its drum, and winding."""
    for place in (0, -1) if fault.end is Winch else (-1, 0):
        node: Node = cable.nodes[place]
        at = place % len(cable.nodes)
        if not isinstance(node, fault.end):
            continue
        if isinstance(node, Winch):
            return at, node.radius, node.winding
        return at, node.radius or ANCHOR_RADIUS, 1
    lacking = fault.end.__name__.lower()
    raise UsageError(f"fault {fault.kind} needs a cable with a {lacking}; {cable.name} has none")


def _elongation(robot: Robot, index: int) -> float:
    """Elongation of a cable under its preload in the reference pose [m]."""
    cable = robot.cables[index]
    length = shape_at(prepare(robot), robot.reference_pose).length[robot.parts[index]].sum()
    secant = secant_at(elasticity_of(cable), cable.preload)
    return float(length * cable.preload / (secant + cable.preload))
