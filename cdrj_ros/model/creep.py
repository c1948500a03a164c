"""Cables of polymer fibres that yield with time: delayed strain and flow, (E24).

A rope of Dyneema, nylon or polyester under constant load goes on lengthening, and at constant
length it loses tension.  Part of this recedes once the load is gone, part remains.  Both follow
the elastic strain (Burgers' model: a spring, a Voigt element and a dashpot in series),

    d(eps_d)/dt = (c eps - eps_d) / tau,        d(eps_f)/dt = eps / tau_f                    (E24)

with the elastic strain eps of (E1) or (E21).  So the cable has the stiffness EA against fast
changes and EA / (1 + c) against those that are slower than tau.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple, Protocol

from cdrj_ros.model.compiled import lean, usable_in_kernels


class Creep(NamedTuple):
    """How a cable yields with time."""

    share: float
    """c: delayed strain under constant load as a share of the elastic strain [-]; 0: none."""
    time: float
    """tau: time constant of the delayed strain at constant load [s]."""
    flow_time: float
    """tau_f: time in which the flow equals the elastic strain [s]; infinite: none."""


class CreepNumbers(Protocol):
    """A row of ``packing.CableNumbers``."""

    creep_share: float
    creep_time: float
    flow_time: float


@usable_in_kernels
def creep_of(cable: CreepNumbers) -> Creep:
    """The law of a row of ``packing.CableNumbers``."""
    return Creep(cable.creep_share, cable.creep_time, cable.flow_time)


@lean
def crept(law: Creep, strain: float, delayed: float, dt: float) -> tuple[float, float]:
    """(E24) over a time in which an element keeps its length.

    Args:
        law: of the cable.
        strain: elastic strain of the element at first; negative by as much as it hangs loose [-].
        delayed: its delayed strain at first [-].
        dt: the time [s].

    Returns:
        The delayed strain afterwards, and the factor by which the unstretched length has grown.
    """
    if strain <= 0.0:  # no load: the delayed strain recedes
        left = delayed * exp(-dt / law.time)
        return left, (1.0 + left) / (1.0 + delayed)
    settled = (strain + delayed) / (1.0 + law.share)
    after = settled + (strain - settled) * exp(-(1.0 + law.share) * dt / law.time)
    return delayed + strain - after, (1.0 + strain) / (1.0 + after * exp(-dt / law.flow_time))
