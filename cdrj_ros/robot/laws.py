"""What each friction law takes from a robot file; the laws are in `cdrj_ros/core/law_*.cpp`.

The simpler laws are limiting cases: what a law does not take has its neutral value in the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

Law = Literal["none", "euler", "steady", "lugre", "elastoplastic"]


@dataclass(frozen=True)
class FrictionLaw:
    """The constants that have an effect."""

    sliding: bool = True
    """Sliding friction ``mu_c``; without it there is no friction at all."""
    static: bool = True
    """Static friction ``mu_s`` and how it fades with the slip speed."""
    bearing: bool = True
    """Friction of bearings: ``rho``, ``bearing_friction`` and ``bearing_torque``."""
    bristles: bool = True
    """Pre-sliding and viscous friction; otherwise the contact is rigid."""


FRICTION_LAWS: Final[Mapping[Law, FrictionLaw]] = MappingProxyType(
    {
        "none": FrictionLaw(sliding=False, static=False, bearing=False, bristles=False),
        "euler": FrictionLaw(static=False, bearing=False, bristles=False),
        "steady": FrictionLaw(bristles=False),
        "lugre": FrictionLaw(),
        "elastoplastic": FrictionLaw(),
    }
)
"""All laws by their names in a robot file, see docs/model.md, section 4."""
