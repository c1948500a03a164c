"""Newton's method for the slips of a cable's pulleys: a tridiagonal system and a line search.

See docs/model.md, section 4.
"""

from __future__ import annotations

from typing import Final

from cdrj_ros.model.balance import balance, tolerance
from cdrj_ros.model.cable_records import Contact, PulleyNumbers, SolverElement
from cdrj_ros.model.compiled import callee, lean, stage
from cdrj_ros.model.elasticity import Elasticity, modulus_at
from cdrj_ros.model.friction import LUGRE, NONE
from cdrj_ros.model.records import Rows

MAX_ITERATIONS: Final = 40
SMALLEST_SHRINK: Final = 0.25
"""A Newton step may not shorten an element below this share of its material."""


@lean
def _element_stiffness(elastic: Elasticity, element: SolverElement) -> float:
    """-dt / dl of an element [N/m]; 0 where it is slack."""
    if not element.tension > 0.0:
        return 0.0
    modulus = elastic.axial_stiffness
    if elastic.bedding_strain != 0.0:
        modulus = modulus_at(elastic, element.tension)
    return float(modulus * (element.length / element.material) / element.material)


@lean
def _matrix_row(
    contact: Contact, k_left: float, k_right: float, pulled_after: bool, slack: float
) -> tuple[float, float, float]:
    """Derivatives of a residual by the slips of the pulley before, this one and the next [N/m].

    The bound of friction depends on the tension on the pull side, so its derivative also adds to
    the column of a neighbouring pulley.

    Args:
        contact: the pulley.
        k_left, k_right: stiffness of the elements before and after it [N/m].
        pulled_after: whether the element after it is on the pull side.
        slack: stiffness [N/m] that replaces that of a slack element in the matrix, not in the
            residual.  Without it a taut element between slack ones makes the system singular.
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
def _newton_step(
    elastic: Elasticity, elements: Rows[SolverElement], contacts: Rows[Contact]
) -> float:
    """Solve the tridiagonal system J step = -residual (Thomas), O(n).

    Returns:
        Fraction in (0, 1] of the step that leaves every element some material.
    """
    n = len(contacts)
    k_left = _element_stiffness(elastic, elements[0])
    upper_before, step_before = 0.0, 0.0
    for i in range(n):
        element, contact = elements[i + 1], contacts[i]
        k_right = _element_stiffness(elastic, element)
        pulled_after = element.tension >= elements[i].tension
        slack = 1e-3 * elastic.axial_stiffness / element.material
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
        share = _shortened(share, step - after, elements[i + 1].material)
        after = step
    return _shortened(share, -after, elements[0].material)


@callee
def _shortened(share: float, change: float, material: float) -> float:
    """Limit the fraction of a step so that an element keeps some material.

    Args:
        share: fraction of the step so far.
        change: change of the element's material by the whole step [m].
        material: the element's material [m].
    """
    most = (SMALLEST_SHRINK - 1.0) * material
    return min(share, most / change) if change < most else share


@callee
def _try_step(
    contacts: Rows[Contact],
    pulleys: Rows[PulleyNumbers],
    hardness: float,
    law: int,
    share: float,
) -> None:
    """Write slip + share * step into ``trial``; stop a step that crosses the elastic range.

    The elastic range of the bristles lies between sliding forward and sliding back.  A step across
    all of it would switch the friction from one bound to the other, and the next iteration would
    switch it back; such a step ends where the bristle force is zero.
    """
    for i in range(len(contacts)):
        slip = contacts[i].slip
        trial = slip + share * contacts[i].step
        if law not in (NONE, LUGRE):
            stiffness = pulleys[i].bristle_stiffness * hardness
            before = contacts[i].bristle_before
            old, new = before + stiffness * slip, before + stiffness * trial
            bound = contacts[i].bound
            if (old > bound and new < -bound) or (old < -bound and new > bound):
                trial = -before / stiffness
        elif law == LUGRE and slip * trial < 0.0:  # the slope jumps where the slip reverses
            trial *= 0.3
        contacts[i].trial = trial


@lean
def newton(
    elastic: Elasticity,
    elements: Rows[SolverElement],
    contacts: Rows[Contact],
    pulleys: Rows[PulleyNumbers],
    hardness: float,
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Newton's method with a line search for (E11), from the slips in ``contacts``.

    Args:
        elastic, elements, contacts, pulleys, hardness, first_slip, last_slip, law, dt: as for
            ``balance``, with n + 1 elements and n contacts; ``contacts`` holds the first guess of
            the slips [m] and gets the solution.

    Returns:
        Iterations and the largest remaining force imbalance [N].

    Takes 9 arguments, see ``balance``.
    """
    n = len(contacts)
    enough = tolerance(elastic)
    for i in range(n):
        contacts[i].trial = contacts[i].slip
    worst = balance(elastic, elements, contacts, pulleys, hardness, first_slip, last_slip, law, dt)
    for iteration in range(MAX_ITERATIONS):
        if worst <= enough:
            return iteration, worst
        share = _newton_step(elastic, elements, contacts)
        best = worst
        for _ in range(6):
            _try_step(contacts, pulleys, hardness, law, share)
            worst = balance(
                elastic, elements, contacts, pulleys, hardness,
                first_slip, last_slip, law, dt,
            )  # fmt: skip
            if worst < best:
                break
            share *= 0.5
        for i in range(n):
            contacts[i].slip = contacts[i].trial
    return MAX_ITERATIONS, worst
