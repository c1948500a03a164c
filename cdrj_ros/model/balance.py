"""The force balance of every contact of a cable: tension of the segments, friction, imbalance.

See docs/model.md, sections 2 and 5.
"""

from __future__ import annotations

from cdrj_ros.model.cable_records import Contact, Segment
from cdrj_ros.model.compiled import inlined, lean, stage
from cdrj_ros.model.elasticity import Elasticity, stiffened_tension
from cdrj_ros.model.friction import BOUND_FLOOR, NONE, friction_force
from cdrj_ros.model.records import Rows


@lean
def tolerance(elastic: Elasticity) -> float:
    """Largest force imbalance of a solved contact [N]; the second term allows for rounding."""
    return 1e-8 + 1e-14 * float(elastic.axial_stiffness)


@lean
def acceptable(elastic: Elasticity) -> float:
    """Largest force imbalance of a usable sample [N]; with a larger one it counts as unsolved."""
    return 1e-4 + 1e-14 * float(elastic.axial_stiffness)


@lean
def element_tension(elastic: Elasticity, length: float, material: float) -> float:
    """Tension of a segment [N]; exact for any amount of winding; (11) is its linearisation.

    It is EA max(L / l - 1, 0) in a linear cable (E1), (E21) in one that stiffens.
    """
    strain = length / material - 1.0
    if elastic.bedding_strain != 0.0 and strain > 0.0:
        return stiffened_tension(elastic, strain)
    return max(elastic.axial_stiffness * strain, 0.0)


@stage
def _friction(
    contact: Contact, hardness: float, slip: float, pull: float, law: int, dt: float
) -> tuple[float, float, float]:
    """Friction of a contact [N], its derivatives by the slip [N/m] and by the pull side's tension.

    The function writes the bristle force and the bound of the contact.
    """
    bound = contact.loss * pull + contact.drag + BOUND_FLOOR
    stiffness = contact.stiffness * hardness
    bristle_before = contact.bristle_before
    force, by_slip, by_bound = friction_force(
        law, bristle_before, slip, stiffness, bound, contact.breakaway
    )
    contact.bristle = force
    contact.bound = bound
    by_pull = by_bound * contact.loss
    if dt > 0.0:
        damping = contact.damping
        if damping != 0.0:
            # sigma1 dz/dt; sigma1 fades with speed: with a constant one LuGre is not passive
            rate = damping * contact.static_share / (contact.stiffness * dt)
            force += rate * (force - bristle_before)
            by_slip *= 1.0 + rate
            by_pull *= 1.0 + rate
        viscous = contact.viscous / dt
        force += viscous * slip
        by_slip += viscous
    return force, by_slip, by_pull


@inlined
def balance(
    elastic: Elasticity,
    segments: Rows[Segment],
    contacts: Rows[Contact],
    hardness: float,
    first_flux: float,
    last_flux: float,
    law: int,
    dt: float,
) -> float:
    """Force imbalance of every contact at its trial flux (E11); returns the largest magnitude [N].

    Residual i is (t_{i+1} - t_i) - friction_i, whose bound is (E8).  Friction follows the slip
    against the body (E25).

    Args:
        elastic: tension-strain law of the cable.
        segments: shape (n + 1,); length [m] and material before [m] are given; material [m] and
            tension [N] are written.
        contacts: shape (n,); constants, trial flux [m], shift [m] and bristle force before [N] are
            given; bristle force, bound, residual [N] and derivatives of friction are written.
        hardness: factor of the bristles' stiffness [-].
        first_flux, last_flux: material that enters at the first and leaves at the last node [m].
        law: code of the friction law.
        dt: duration of the sample [s]; 0 where unknown.
    """
    n = len(contacts)
    worst = 0.0
    flux = contacts[0].trial
    material = segments[0].material_before + first_flux - flux
    segments[0].material = material
    t_left = element_tension(elastic, segments[0].length, material)
    segments[0].tension = t_left
    for i in range(n):
        following = contacts[i + 1].trial if i + 1 < n else last_flux
        material = segments[i + 1].material_before + flux - following
        segments[i + 1].material = material
        t_right = element_tension(elastic, segments[i + 1].length, material)
        segments[i + 1].tension = t_right
        force, by_slip, by_pull = 0.0, 0.0, 0.0
        if law != NONE:
            pull = max(t_left, t_right)
            slip = flux + contacts[i].shift
            force, by_slip, by_pull = _friction(contacts[i], hardness, slip, pull, law, dt)
        contacts[i].by_slip = by_slip
        contacts[i].by_pull = by_pull
        residual = t_right - t_left - force
        contacts[i].residual = residual
        if not abs(residual) <= worst:  # true for NaN too
            worst = abs(residual)
        t_left = t_right
        flux = following
    return worst
