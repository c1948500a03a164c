"""Faults of the rig that no encoder measures: a drum slips on its shaft, an anchor yields.

The moving end of the cable is driven by an additional motor, which turns as the fault requires.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.laws import elasticity_of, secant_at, strain_at
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.description import Anchor, Cable, Motor, Node, Robot, Winch
from cdrj_ros.simulation.motion import smooth_step

FaultKind = Literal["slack", "snap", "slip"]
KINDS: Final[tuple[FaultKind, ...]] = get_args(FaultKind)
"""``slack``: the anchor creeps until hardly any preload is left in the cable and in those on the
same motor; ``snap``: the anchor suddenly yields by half of the cable's own elongation under
preload; ``slip``: for a while the drum turns less than its encoder, by the same length of cable."""

DURATION_S: Final = {"slack": 2.0, "snap": 0.002, "slip": 0.5}
"""Duration of a fault [s]."""

USUAL_SHARE: Final = {"slack": 0.9, "snap": 0.5, "slip": 0.5}
"""Share of the elongation under preload that a fault removes if no amount is given."""

FaultName = Literal["slack", "snap", "slip", "cut"]
"""Faults that can be injected at any time.  ``cut`` is a snap by ``CUT_LENGTH``, which no winch can
take up again, and removes the cable's friction."""

FAULT_NAMES: Final[tuple[FaultName, ...]] = get_args(FaultName)

CUT_LENGTH: Final = 10.0
"""Length of cable that a cut releases [m]."""

LARGEST_AMOUNT: Final = {"slack": 1.0, "snap": 1.0, "slip": 100.0}
"""Largest amount of each fault: length of cable [m] or angle of the drum [rad]."""

ANCHOR_RADIUS: Final = 0.01
"""Radius of the drum that represents a yielding anchor [m]; its value is arbitrary."""


@dataclass(frozen=True)
class Fault:
    """A fault at one end of one cable."""

    kind: FaultKind
    begin: float
    """Start of the fault on the truth's clock [s]."""
    amount: float | None = None
    """Length of cable [m] for ``slack`` and ``snap``, angle of the drum [rad] for ``slip``; None
    for the default."""
    cable: str | None = None
    """Name of the cable; None for the robot's first cable."""


@dataclass(frozen=True)
class Wiring:
    """A robot with an additional motor for every faulty end."""

    robot: Robot
    """The robot; its first motors are those of the robot without faults."""
    owner: NDArray[np.int64]
    """Index of the motor that each motor turns with, -1 for none; shape (all motors,)."""
    faults: tuple[tuple[int, Fault], ...]
    """Index of the motor that each fault moves, and the fault with its amount and cable set."""
    turn: Vector
    """Total rotation of each of these motors [rad], shape (faults,)."""

    def without_faults(self) -> Wiring:
        """The same motors, none of which a fault moves."""
        return replace(self, faults=(), turn=np.empty(0))

    def with_fault(self, motor: int, fault: Fault, turn: float) -> Wiring:
        """The wiring with one more fault, which turns a motor by ``turn`` [rad]."""
        return replace(self, faults=(*self.faults, (motor, fault)), turn=np.append(self.turn, turn))

    def offset(self, time: Vector) -> NDArray[np.float64]:
        """Angle of each motor relative to its owner [rad], shape (n, all motors)."""
        offset = np.zeros((time.size, self.owner.size))
        for (motor, fault), turn in zip(self.faults, self.turn, strict=True):
            offset[:, motor] += turn * smooth_step((time - fault.begin) / DURATION_S[fault.kind])
        return offset

    def during(self, time: Vector) -> NDArray[np.bool_]:
        """Whether a fault is in progress, shape (n,)."""
        happening = np.zeros(time.shape, dtype=np.bool_)
        for _, fault in self.faults:
            happening |= (time >= fault.begin) & (time <= fault.begin + DURATION_S[fault.kind])
        return happening


def wire(robot: Robot, faults: tuple[Fault, ...]) -> Wiring:
    """Add a motor for every cable end that the faults move.

    Raises:
        UsageError: a cable does not exist, has no such end, or needs an amount.
    """
    names = [motor.name for motor in robot.motors]
    owner = list(range(len(names)))
    motors, cables = list(robot.motors), list(robot.cables)
    moved: list[tuple[int, Fault]] = []
    turns: list[float] = []
    taken: dict[tuple[int, int], int] = {}
    for fault in faults:
        index = _cable_of(robot, fault)
        cable = robot.cables[index]
        place, radius, winding = _end(cable, fault)
        stretch = 1.0 + strain_at(elasticity_of(cable), cable.preload)
        if (index, place) not in taken:
            taken[index, place] = len(motors)
            node = cable.nodes[place]
            if isinstance(node, Winch):
                motor = robot.motors[names.index(node.motor)]
                owner.append(names.index(node.motor))
                extra = Motor(
                    f"{cable.name}_drum", motor.reference_angle, effort_sign=motor.effort_sign
                )
            else:
                owner.append(-1)
                extra = Motor(f"{cable.name}_anchor")
            motors.append(extra)
            nodes = list(cables[index].nodes)
            nodes[place] = Winch(extra.name, radius, winding, node.place)
            cables[index] = replace(cables[index], nodes=tuple(nodes))
        amount = fault.amount
        if amount is None:
            together = _wound_together(robot, index) if fault.kind == "slack" else [index]
            paid_out = USUAL_SHARE[fault.kind] * sum(_elongation(robot, c) for c in together)
            amount = paid_out * stretch / radius if fault.kind == "slip" else paid_out
            if not amount > 0.0:
                raise UsageError(
                    f"fault {fault.kind} of {cable.name} needs an amount: without preload there is "
                    "none to lose"
                )
        moved.append((taken[index, place], replace(fault, amount=amount, cable=cable.name)))
        turns.append(-winding * (amount if fault.kind == "slip" else amount * stretch / radius))
    wired = replace(robot, motors=tuple(motors), cables=tuple(cables)) if faults else robot
    return Wiring(wired, np.array(owner, dtype=np.int64), tuple(moved), np.array(turns))


def wire_all(robot: Robot) -> Wiring:
    """The wiring of all faults that the robot's cables may have, none of which happens."""
    ends = {Anchor: ("slack", "snap"), Winch: ("slip",)}
    possible = tuple(
        # a cable without preload has no default amount, and the motor does not depend on it
        Fault(cast(FaultKind, kind), 0.0, None if cable.preload > 0.0 else 1e-3, cable.name)
        for cable in robot.cables
        for end, kinds in ends.items()
        if any(isinstance(node, end) for node in (cable.nodes[0], cable.nodes[-1]))
        for kind in kinds
    )
    return wire(robot, possible)


def fault_now(
    robot: Robot, name: FaultName, cable: str, amount: float | None, now_s: float
) -> Fault:
    """A fault that begins now, with its amount set.

    Args:
        robot: the robot.
        name: name of the fault.
        cable: name of the faulty cable.
        amount: length of cable [m] for ``slack`` and ``snap``, angle of the drum [rad] for
            ``slip``; None for the default.  A cut takes no amount.
        now_s: start of the fault [s].

    Raises:
        UsageError: an unknown fault or cable, or an impossible amount.
    """
    if name not in FAULT_NAMES:
        raise UsageError(f"fault must be one of {', '.join(FAULT_NAMES)}, got {name!r}")
    if name == "cut":
        if amount is not None:
            raise UsageError(f"a cut takes no amount, got {amount:g}")
        return wire(robot, (Fault("snap", now_s, CUT_LENGTH, cable),)).faults[0][1]
    if amount is not None:
        check_amount(name, amount)
    return wire(robot, (Fault(name, now_s, amount, cable),)).faults[0][1]


def check_amount(kind: FaultKind, amount: float) -> None:
    """Refuse an impossible amount of a fault [m] or [rad].

    Raises:
        UsageError: names the range.
    """
    if not 0.0 < amount <= LARGEST_AMOUNT[kind]:
        raise UsageError(
            f"the amount of {kind} must be in (0, {LARGEST_AMOUNT[kind]:g}], got {amount:g}"
        )


def _cable_of(robot: Robot, fault: Fault) -> int:
    names = [cable.name for cable in robot.cables]
    if fault.cable is None:
        return 0
    if fault.cable not in names:
        raise UsageError(
            f"fault {fault.kind} names the cable {fault.cable}; there are {', '.join(names)}"
        )
    return names.index(fault.cable)


def _end(cable: Cable, fault: Fault) -> tuple[int, float, int]:
    """Index of the moving node, radius of its drum, and winding."""
    for place in (0, -1) if fault.kind == "slip" else (-1, 0):
        node: Node = cable.nodes[place]
        at = place % len(cable.nodes)
        if fault.kind == "slip" and isinstance(node, Winch):
            return at, node.radius, node.winding
        if fault.kind != "slip" and isinstance(node, Anchor):
            return at, node.radius or ANCHOR_RADIUS, 1
    lacking = "winch" if fault.kind == "slip" else "anchor"
    raise UsageError(f"fault {fault.kind} needs a cable with a {lacking}; {cable.name} has none")


def _wound_together(robot: Robot, index: int) -> list[int]:
    """Indices of the cables that share a motor with this one, including itself."""
    motors = [
        {node.motor for node in cable.nodes if isinstance(node, Winch)} for cable in robot.cables
    ]
    return [c for c, own in enumerate(motors) if c == index or own & motors[index]]


def _elongation(robot: Robot, index: int) -> float:
    """Elongation of a cable under its preload in the reference pose [m]."""
    cable = robot.cables[index]
    length = shape_at(prepare(robot), robot.reference_pose).length[robot.parts[index]].sum()
    secant = secant_at(elasticity_of(cable), cable.preload)
    return float(length * cable.preload / (secant + cable.preload))
