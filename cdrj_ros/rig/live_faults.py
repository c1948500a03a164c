"""Faults that can be injected into a live rig at any time, as all cable ends are prepared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.rig.faults import Fault, FaultKind, Wiring
from cdrj_ros.robot.description import Anchor, Robot, Winch

FaultName = Literal["slack", "snap", "slip", "cut"]
"""Faults of the cables.  ``slack``, ``snap`` and ``slip`` are those of ``rig/faults.py``; ``cut``
releases ``CUT_LENGTH`` of cable, which no winch can take up again, and removes its friction."""

FAULT_NAMES: Final[tuple[FaultName, ...]] = get_args(FaultName)

CUT_LENGTH: Final = 10.0
"""Length of cable that a cut releases [m]."""

LARGEST_AMOUNT: Final = {"slack": 1.0, "snap": 1.0, "slip": 100.0}
"""Largest amount of each fault: length of cable [m] or angle of the drum [rad]."""

_ENDS: Final[tuple[tuple[FaultKind, type], ...]] = (
    ("slack", Anchor),
    ("snap", Anchor),
    ("slip", Winch),
)


def possible_faults(robot: Robot) -> tuple[Fault, ...]:
    """All faults possible for the robot's cables; for cables without preload with an amount."""
    return tuple(
        Fault(kind, 0.0, None if cable.preload > 0.0 else 1e-3, cable.name)
        for cable in robot.cables
        for kind, end in _ENDS
        if any(isinstance(node, end) for node in (cable.nodes[0], cable.nodes[-1]))
    )


@dataclass(frozen=True)
class Breakable:
    """The cable ends of a rig that have an additional motor for faults."""

    cables: tuple[str, ...]
    motors: Mapping[tuple[str, str], int]
    """Index of the motor of the end that a fault (kind, cable) moves."""
    usual: Mapping[tuple[str, str], float]
    """Default amounts, derived from the preload, for cables with a preload."""

    @classmethod
    def of(cls, robot: Robot, wiring: Wiring) -> Breakable:
        """Build it from ``wiring``, which must be that of all ``possible_faults``."""
        preloaded = {cable.name for cable in robot.cables if cable.preload > 0.0}
        places = {(str(fault.kind), str(fault.cable)): motor for motor, fault in wiring.faults}
        usual = {
            (str(fault.kind), str(fault.cable)): float(fault.amount or 0.0)
            for _, fault in wiring.faults
            if fault.cable in preloaded
        }
        return cls(tuple(cable.name for cable in robot.cables), places, usual)

    def fault(
        self, name: FaultName, cable: str, amount: float | None, now_s: float
    ) -> tuple[int, Fault]:
        """Index of the motor that a fault moves, and the fault.

        Args:
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
        if cable not in self.cables:
            raise UsageError(f"cable must be one of {', '.join(self.cables)}, got {cable!r}")
        kind: FaultKind = "snap" if name == "cut" else name
        if (kind, cable) not in self.motors:
            end = "winch" if kind == "slip" else "anchor"
            raise UsageError(f"{name} needs a cable with one {end}; {cable} has none")
        return self.motors[kind, cable], Fault(
            kind, now_s, self._amount(name, cable, amount), cable
        )

    def _amount(self, name: FaultName, cable: str, amount: float | None) -> float:
        """Amount of a fault: length of cable [m] or angle of the drum [rad]."""
        if name == "cut":
            if amount is not None:
                raise UsageError(f"a cut takes no amount, got {amount:g}")
            return CUT_LENGTH
        if amount is None:
            if (name, cable) not in self.usual:
                raise UsageError(f"{name} of {cable} needs an amount: it has no preload to lose")
            return self.usual[name, cable]
        if not 0.0 < amount <= LARGEST_AMOUNT[name]:
            raise UsageError(
                f"the amount of {name} must be in (0, {LARGEST_AMOUNT[name]:g}], got {amount:g}"
            )
        return amount
