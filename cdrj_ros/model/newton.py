"""Newton's method for the fluxes of a cable's contacts: a tridiagonal system and a line search.

See docs/model.md, section 5.
"""

from __future__ import annotations

from typing import Final

from cdrj_ros.model.balance import balance, tolerance
from cdrj_ros.model.cable_records import Contact, Segment
from cdrj_ros.model.compiled import callee, lean, stage
from cdrj_ros.model.elasticity import Elasticity, modulus_at
from cdrj_ros.model.friction import LUGRE, NONE
from cdrj_ros.model.records import Rows

MAX_ITERATIONS: Final = 40
SMALLEST_SHRINK: Final = 0.25
"""A Newton step may not shorten a segment below this share of its material."""


@lean
def _segment_stiffness(elastic: Elasticity, segment: Segment) -> float:
    """-dt / dl of a segment [N/m]; 0 where it is slack."""
    if not segment.tension > 0.0:
        return 0.0
    modulus = elastic.axial_stiffness
    if elastic.bedding_strain != 0.0:
        modulus = modulus_at(elastic, segment.tension)
    return float(modulus * (segment.length / segment.material) / segment.material)


@lean
def _matrix_row(
    contact: Contact, k_left: float, k_right: float, pulled_after: bool, slack: float
) -> tuple[float, float, float]:
    """Derivatives of a residual by the fluxes of the contact before, this one and the next [N/m].

    The bound of friction depends on the tension on the pull side, so its derivative also adds to
    the column of a neighbouring contact.

    Args:
        contact: the contact.
        k_left, k_right: stiffness of the segments before and after it [N/m].
        pulled_after: whether the segment after it is on the pull side.
        slack: stiffness [N/m] that replaces that of a slack segment in the matrix, not in the
            residual.  Without it a taut segment between slack ones makes the system singular.
    """
    lower, upper = k_left, k_right
    diagonal = -(k_left + k_right) - contact.by_slip
    if k_left == 0.0:
        diagonal -= slack
    if k_right == 0.0:
        diagonal -= slack
    if pulled_after:
        diagonal += contact.by_pull * k_right
        upper -= contact.by_pull * k_right
    else:
        diagonal -= contact.by_pull * k_left
        lower += contact.by_pull * k_left
    return lower, diagonal, upper


@stage
def _newton_step(elastic: Elasticity, segments: Rows[Segment], contacts: Rows[Contact]) -> float:
    """Solve the tridiagonal system J step = -residual (Thomas), O(n).

    Returns:
        Fraction in (0, 1] of the step that leaves every segment some material.
    """
    n = len(contacts)
    k_left = _segment_stiffness(elastic, segments[0])
    upper_before, step_before = 0.0, 0.0
    for i in range(n):
        segment, contact = segments[i + 1], contacts[i]
        k_right = _segment_stiffness(elastic, segment)
        pulled_after = segment.tension >= segments[i].tension
        slack = 1e-3 * elastic.axial_stiffness / segment.material
        lower, diagonal, upper = _matrix_row(contact, k_left, k_right, pulled_after, slack)
        scale = 1.0 / (diagonal - lower * upper_before)
        step_before = (-contact.residual - lower * step_before) * scale
        upper_before = upper * scale
        contact.upper, contact.step = upper_before, step_before
        k_left = k_right
    share = 1.0
    after = 0.0
    for i in range(n - 1, -1, -1):
        step = contacts[i].step - contacts[i].upper * after if i + 1 < n else contacts[i].step
        contacts[i].step = step
        share = _shortened(share, step - after, segments[i + 1].material)
        after = step
    return _shortened(share, -after, segments[0].material)


@callee
def _shortened(share: float, change: float, material: float) -> float:
    """Limit the fraction of a step so that a segment keeps some material.

    Args:
        share: fraction of the step so far.
        change: change of the segment's material by the whole step [m].
        material: the segment's material [m].
    """
    most = (SMALLEST_SHRINK - 1.0) * material
    return min(share, most / change) if change < most else share


@callee
def _try_step(
    contacts: Rows[Contact],
    hardness: float,
    law: int,
    share: float,
) -> None:
    """Write flux + share * step into ``trial``; stop a step that crosses the elastic range.

    The elastic range of the bristles lies between sliding forward and sliding back.  A step across
    all of it would switch the friction from one bound to the other, and the next iteration would
    switch it back; such a step ends where the bristle force is zero.
    """
    for i in range(len(contacts)):
        shift = contacts[i].shift
        trial = contacts[i].flux + share * contacts[i].step
        slip, next_slip = contacts[i].flux + shift, trial + shift
        if law not in (NONE, LUGRE):
            stiffness = contacts[i].stiffness * hardness
            before = contacts[i].bristle_before
            old, new = before + stiffness * slip, before + stiffness * next_slip
            bound = contacts[i].bound
            if (old > bound and new < -bound) or (old < -bound and new > bound):
                trial = -before / stiffness - shift
        elif law == LUGRE and slip * next_slip < 0.0:  # the slope jumps where the slip reverses
            trial = 0.3 * next_slip - shift
        contacts[i].trial = trial


@lean
def newton(
    elastic: Elasticity,
    segments: Rows[Segment],
    contacts: Rows[Contact],
    hardness: float,
    first_flux: float,
    last_flux: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Newton's method with a line search for (E11), from the fluxes in ``contacts``.

    Args:
        elastic, segments, contacts, hardness, first_flux, last_flux, law, dt: as for ``balance``,
            with n + 1 segments and n contacts; ``contacts`` holds the first guess of the fluxes
            [m] and gets the solution.

    Returns:
        Iterations and the largest remaining force imbalance [N].
    """
    n = len(contacts)
    enough = tolerance(elastic)
    for i in range(n):
        contacts[i].trial = contacts[i].flux
    worst = balance(elastic, segments, contacts, hardness, first_flux, last_flux, law, dt)
    for iteration in range(MAX_ITERATIONS):
        if worst <= enough:
            return iteration, worst
        share = _newton_step(elastic, segments, contacts)
        best = worst
        for _ in range(6):
            _try_step(contacts, hardness, law, share)
            worst = balance(elastic, segments, contacts, hardness, first_flux, last_flux, law, dt)
            if worst < best:
                break
            share *= 0.5
        for i in range(n):
            contacts[i].flux = contacts[i].trial
    return MAX_ITERATIONS, worst
