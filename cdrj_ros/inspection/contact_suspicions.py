"""Values of friction and slip on pulleys that are probably wrong or missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any, Final

from cdrj_ros.inspection.checks import CableCheck, PulleyCheck, Suspicion
from cdrj_ros.model.laws import elasticity_of, modulus_at
from cdrj_ros.robot.description import Cable, Friction, Pulley, friction_law

LARGEST_UNSTATED: Final = 0.01
"""Relative error of the tension beyond a pulley that an unstated moving end may cause without being
reported [-]: the accuracy of a good load cell, below which nobody could notice."""


def contact_suspicions(
    cable: Cable, check: CableCheck, nodes: Sequence[Mapping[str, Any]]
) -> Iterator[Suspicion]:
    """Find what is suspicious about the contacts of one cable.

    Args:
        cable: the cable.
        check: what the inspection found of it.
        nodes: its nodes in the file, in SI; empty for a robot that was not read from a file.
    """
    yield from _moving_ends(cable, check, nodes)
    yield from _slip(cable, check)
    yield from _friction(cable)


def _slip(cable: Cable, check: CableCheck) -> Iterator[Suspicion]:
    for k, pulley in enumerate(check.pulleys):
        if pulley.transmission_at_rest.low >= 1.0 or pulley.passing > max(pulley.needed, 1e-6):
            continue
        bound = (1.0 - pulley.transmission_at_rest.low) * check.followed.high
        yield Suspicion(
            pulley.name,
            f"the joints move {1e6 * pulley.passing:.1f} µm of cable over it"
            + (
                f", {1e6 * pulley.needed:.1f} µm are needed to know its friction"
                if pulley.needed > 0.0
                else ""
            )
            + f": it slips only if the tension changes by about {_swing(cable, check, k, pulley)}; "
            f"until then the tensions behind it are only known to ±{bound:.2g} N",
            grave=False,
        )


def _moving_ends(
    cable: Cable, check: CableCheck, nodes: Sequence[Mapping[str, Any]]
) -> Iterator[Suspicion]:
    """Report given wraps that change while the file does not say which end of the arc moves.

    The default is wrong by radius * change / 2 of slip at most.  That slip takes friction towards
    its other bound, which it reaches after ``needed`` with 2 (1 - eta) of the tension.
    """
    for pulley, node, entry in zip(check.pulleys, cable.pulleys, nodes[1:-1], strict=False):
        turned = pulley.wrap.width
        if "wrap_angle" not in entry or "moving_end" in entry or turned == 0.0:
            continue
        slip = 0.5 * node.radius * turned
        share = slip / pulley.needed if slip < pulley.needed else 1.0
        change = share * 2.0 * (1.0 - pulley.transmission_at_rest.low)
        if change > LARGEST_UNSTATED:
            yield Suspicion(
                pulley.name,
                f"the wrap changes by {degrees(turned):.1f}°, but no moving_end says at which end "
                f"of the arc: its slip is only known to ±{1e3 * slip:.2g} mm, and the tension "
                f"beyond it may be wrong by {100.0 * change:.2g} %; give before, after or both",
            )


def _swing(cable: Cable, check: CableCheck, k: int, pulley: PulleyCheck) -> str:
    """Change of tension ahead of a pulley that takes its friction from one bound to the other."""
    bound = (1.0 - pulley.transmission_at_rest.low) * check.followed.high
    modulus = modulus_at(elasticity_of(cable), check.followed.high)
    behind = modulus / sum(element.length.high for element in check.elements[k + 1 :])
    contact = cable.pulleys[k].friction.bristle_stiffness
    return f"{2.0 * bound * (1.0 + behind / contact):.2g} N"


def _friction(cable: Cable) -> Iterator[Suspicion]:
    """Report friction keys without effect; pulleys with the same finding are grouped."""
    groups: dict[str, list[str]] = {}
    for name, pulley in zip(cable.pulley_names, cable.pulleys, strict=True):
        for text in _without_effect(cable, pulley):
            groups.setdefault(text, []).append(name)
    for text, names in groups.items():
        alike = len(names) == len(cable.pulleys) and len(names) > 1
        where = cable.name if alike else ", ".join(names)
        yield Suspicion(where, text, grave=not text.startswith("no friction"))


def _without_effect(cable: Cable, pulley: Pulley) -> Iterator[str]:
    friction = pulley.friction
    law = friction_law(cable.law)
    if not law.sliding:
        if friction.mu_c > 0.0 or friction.bearing_friction > 0.0:
            yield f"law is {cable.law}: mu_c and bearing_friction are without effect"
        return
    yield from _static_without_effect(cable, friction)
    bearing = friction.bearing_friction > 0.0 and pulley.bearing_diameter > 0.0
    if bearing and (friction.rho == 1.0 or not law.bearing):
        yield (
            "bearing_friction is without effect: "
            + (
                "rho is 1: sliding friction only"
                if law.bearing
                else f"law {cable.law} has sliding friction only"
            )
        )
    if friction.bearing_friction > 0.0 and pulley.bearing_diameter == 0.0 and friction.rho < 1.0:
        yield "bearing_friction is without effect: bearing_diameter is 0"
    sliding = friction.rho > 0.0 or not law.bearing
    if friction.mu_c > 0.0 and not sliding:
        yield f"mu_c = {friction.mu_c:g} is without effect: rho is 0, only the bearing counts"
    if not (bearing or pulley.bearing_torque > 0.0) and (friction.mu_c == 0.0 or not sliding):
        yield f"no friction at all, although law is {cable.law}"


def _static_without_effect(cable: Cable, friction: Friction) -> Iterator[str]:
    """Report mu_s or stribeck_speed if it has no effect."""
    if friction.mu_s == friction.mu_c:
        if friction.stribeck_speed is not None:
            yield "stribeck_speed is without effect: mu_s equals mu_c"
        return
    reason = ""
    if not friction_law(cable.law).static:
        reason = f"law {cable.law} has no static friction"
    elif friction.rho == 0.0:
        reason = "rho is 0: only the bearing counts"
    elif friction.mu_c == 0.0 and friction.stribeck == "printed":
        reason = "the printed form scales mu_c, which is 0"
    if reason:
        yield f"mu_s = {friction.mu_s:g} is without effect: {reason}"
