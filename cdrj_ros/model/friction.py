"""Friction of a cable on a pulley: equations (29)-(43) of the source and the dynamic laws.

Notation: ``wrap_angle`` beta [rad], ``slip_speed`` v [m/s], ``transmission`` eta = T_hold / T_pull
in (0, 1], ``bound`` g [N] the largest difference T_pull - T_hold that friction can carry.
Equation numbers are those of docs/model.md, which keeps the numbering of the source.
"""

from __future__ import annotations

from math import cos, exp, sqrt
from typing import Final, get_args

from cdrj_ros.model.compiled import inlined, lean
from cdrj_ros.robot.description import LAWS, StribeckForm

# The code of a law or a form is its place among the words of a robot file.
NONE, EULER, STEADY, LUGRE, ELASTOPLASTIC = range(len(LAWS))

STRIBECK_FORMS: Final[tuple[StribeckForm, ...]] = get_args(StribeckForm)
"""How static friction enters: (35) as printed, or the capstan equation with mu_s."""

PRINTED, CAPSTAN = range(len(STRIBECK_FORMS))

RIGID_BRISTLE: Final = 1e9
"""Contact stiffness [N/m] that stands for a rigid contact in the laws ``euler`` and ``steady``."""

MINIMUM_TRANSMISSION: Final = 1e-3
"""Floor of eta: the printed (35) goes below zero for large mu_s / mu_c and wrap angles."""

BOUND_FLOOR: Final = 1e-9
"""epsilon of (34) [N]: keeps the bound positive on a slack cable."""


@lean
def capstan_transmission(mu: float, wrap_angle: float) -> float:
    """(29)-(32): T_hold / T_pull of a cable sliding over a fixed cylinder."""
    return exp(-mu * wrap_angle)


@lean
def stribeck_share(slip_speed: float, stribeck_speed: float) -> float:
    """Share in [0, 1] of static friction that is left at a slip speed: the last factor of (33)."""
    ratio = slip_speed / stribeck_speed
    return exp(-ratio * ratio)


@lean
def sliding_loss(mu_c: float, mu_s: float, wrap_angle: float, stribeck: int) -> tuple[float, float]:
    """(34)-(37) as ``1 - eta_d = kinetic + static * stribeck_share(v)``; returns (kinetic, static).

    ``printed`` scales the kinetic loss by mu_s / mu_c as in (35); ``capstan`` lets the loss at
    rest be 1 - exp(-mu_s beta).
    """
    kinetic = 1.0 - capstan_transmission(mu_c, wrap_angle)
    if stribeck == CAPSTAN:
        return kinetic, capstan_transmission(mu_c, wrap_angle) - capstan_transmission(
            mu_s, wrap_angle
        )
    if mu_c <= 0.0:
        return 0.0, 0.0
    return kinetic, kinetic * (mu_s / mu_c - 1.0)


@lean
def sliding_transmission(
    slip_speed: float,
    mu_c: float,
    mu_s: float,
    stribeck_speed: float,
    wrap_angle: float,
    stribeck: int,
) -> float:
    """(37): eta_d at a slip speed [m/s], kept above ``MINIMUM_TRANSMISSION``."""
    kinetic, static = sliding_loss(mu_c, mu_s, wrap_angle, stribeck)
    loss = kinetic + static * stribeck_share(slip_speed, stribeck_speed)
    return max(1.0 - loss, MINIMUM_TRANSMISSION)


@lean
def bearing_transmission(wrap_angle: float, bearing_ratio: float) -> float:
    """(41): eta_r of a pulley that turns on a bearing, from the balance (39), the quadratic (40).

    ``bearing_ratio`` = f_d d / r_p = 1 / alpha, so that a frictionless bearing is 0, not infinity.
    Numerator and denominator of (41) are divided by alpha^2.
    """
    c = bearing_ratio * bearing_ratio
    cosine = cos(wrap_angle)
    root = sqrt(max((1.0 - cosine) * (2.0 - c * cosine - c) * c, 0.0))
    return (1.0 - c * cosine - root) / (1.0 - c)


@lean
def blended_loss(
    rho: float,
    mu_c: float,
    mu_s: float,
    wrap_angle: float,
    bearing_ratio: float,
    stribeck: int,
) -> tuple[float, float]:
    """(42), (43): ``1 - eta = kinetic + static * stribeck_share(v)`` of a pulley.

    The transmission is eta = rho eta_d + (1 - rho) eta_r.  Returns (kinetic, static).  Their sum is
    kept below 1 - ``MINIMUM_TRANSMISSION``.
    """
    kinetic, static = sliding_loss(mu_c, mu_s, wrap_angle, stribeck)
    bearing = 1.0 - bearing_transmission(wrap_angle, bearing_ratio)
    most = 1.0 - MINIMUM_TRANSMISSION
    kinetic = min(rho * kinetic + (1.0 - rho) * bearing, most)
    return kinetic, min(rho * static, most - kinetic)


@lean
def cell_loss(kinetic: float, static: float, share: float) -> tuple[float, float]:
    """(E28): losses of a contact cell that has a share of its pulley's wrap.

    The transmissions of all cells multiply to that of the pulley, at rest and at high speed.
    """
    if share == 1.0:
        return kinetic, static
    fast = (1.0 - kinetic) ** share
    return 1.0 - fast, fast - (1.0 - kinetic - static) ** share


@inlined
def friction_force(
    law: int, before: float, slip: float, stiffness: float, bound: float, breakaway: float
) -> tuple[float, float, float]:
    """(33), (E9): bristle force after a slip, exact over the slip for a constant bound.

    Args:
        law: code of the friction law; ``LUGRE`` or one of the elastoplastic family.
        before: bristle force sigma0 z before the slip [N].
        slip: material that moved past the pulley [m].
        stiffness: sigma0 [N/m].
        bound: g = (1 - eta) T_pull [N], positive.
        breakaway: share of the bound up to which pre-sliding is purely elastic, in [0, 1].

    Returns:
        Force [N], its derivative by the slip [N/m] and by the bound [-].

    LuGre (33) without viscous terms is ``df/dx = sigma0 (1 - sgn(x) f / g)``, so over a slip x
    the distance to the bound shrinks by exp(-sigma0 |x| / g).  The elastoplastic law (Dupont,
    Hayward, Armstrong, Altpeter 2002) keeps ``df/dx = sigma0`` until ``breakaway * g`` and closes
    the rest exponentially, which is continuous in slope; with breakaway = 1 it is an elastic,
    perfectly plastic contact whose minor loops close exactly.
    """
    sign = 1.0 if slip >= 0.0 else -1.0
    x = sign * slip
    f = sign * before  # mirrored so that the slip is forward
    if law == LUGRE:
        decay = exp(-stiffness * x / bound)
        force = bound + (f - bound) * decay
        by_slip = -(f - bound) * decay * stiffness / bound
        by_bound = 1.0 - decay + (f - bound) * decay * stiffness * x / (bound * bound)
        return sign * force, by_slip, sign * by_bound
    elastic_by_bound = 0.0
    if f < -bound:  # the bound has shrunk below the stored force: bristles let go first
        f = -bound
        elastic_by_bound = -1.0
    knee = breakaway * bound
    trial = f + stiffness * x
    if trial <= knee:
        return sign * trial, stiffness, sign * elastic_by_bound
    if f >= bound or breakaway >= 1.0:
        return sign * bound, 0.0, sign
    reach = (1.0 - breakaway) * bound / stiffness
    if f >= knee:
        decay = exp(-x / reach)
        gap = bound - f
        force = bound - gap * decay
        by_bound = 1.0 - decay - gap * decay * x / (reach * bound)
        return sign * force, gap * decay / reach, sign * by_bound
    plastic = x - (knee - f) / stiffness
    decay = exp(-plastic / reach)
    force = bound - (bound - knee) * decay
    by_bound = 1.0 - decay * (1.0 - elastic_by_bound + stiffness * plastic / bound)
    return sign * force, stiffness * decay, sign * by_bound
