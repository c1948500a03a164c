"""One sample of one cable: all its pulleys solved together.

A cable of n nodes has n - 1 elements and n - 2 pulleys.  Arrays count elements and pulleys from 0:
pulley ``i`` lies between elements ``i`` and ``i + 1``.  The unknowns are the slips of the pulleys:
the unstretched material that moves past each towards the last node.
See docs/model.md, sections 2 to 4.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cdrj_ros.model.compiled import compiled, lean, stage
from cdrj_ros.model.elasticity import Elasticity, modulus_at, stiffened_tension
from cdrj_ros.model.friction import BOUND_FLOOR, LUGRE, NONE, friction_force
from cdrj_ros.model.records import Rows, record_type


class PulleyNumbers:
    """One pulley of the robot: friction constants, and the wrap where it never changes."""

    radius: float
    """From the axis to the cable's centre line [m]."""
    rho: float
    """Share of sliding friction in the blend (42) [-]."""
    mu_c: float
    """Coulomb coefficient [-]."""
    mu_s: float
    """Static coefficient [-]."""
    stribeck_speed: float
    """v_s of (33) [m/s]."""
    stribeck_lag: float
    """Time by which static friction lags behind the slip speed [s], (E10)."""
    bearing_ratio: float
    """1 / alpha of (41) [-]."""
    drag: float
    """Friction force of the bearing without load [N]."""
    bristle_stiffness: float
    """sigma0 [N/m]."""
    bristle_damping: float
    """sigma1 [N s/m]."""
    viscous: float
    """sigma2 [N s/m]."""
    breakaway: float
    """Fraction of the bound up to which pre-sliding is elastic [-]."""
    cells: float
    """Number of equal contact cells of the whole pulley, of which this is one; a whole number."""
    wrap: float
    """Constant part of the wrap angle [rad]."""
    kinetic_loss: float
    """Loss 1 - eta at high slip speed where the wrap never changes [-]."""
    static_loss: float
    """Further loss at rest where the wrap never changes [-]."""
    half_sine: float
    """sin(wrap / 2) where the wrap never changes."""
    half_cosine: float
    """cos(wrap / 2) where the wrap never changes."""


class SolverElement:
    """One element in the solver."""

    length_before: float
    """Geometric length at the sample before [m]."""
    length: float
    """Geometric length now [m]."""
    material_before: float
    """Unstretched length at the sample before [m]."""
    material: float
    """Unstretched length now [m]."""
    tension: float
    """[N]."""


class Contact:
    """One pulley in the solver: its unknown slip, its friction and its row of the linear system."""

    slip: float
    """Material that moves past the pulley towards the last node in this sample [m]."""
    bristle_before: float
    """Bristle force at the sample before [N]."""
    bristle: float
    """Bristle force now [N]."""
    loss: float
    """1 - eta at the lagged slip speed [-]."""
    static_share: float
    """Share of static friction that remains at the lagged slip speed [-]."""
    bound: float
    """Largest friction force, g of (34) [N]."""
    trial: float
    """Slip at which the imbalance is evaluated [m]."""
    step: float
    """Newton step of the slip [m]."""
    residual: float
    """Force imbalance at ``trial`` [N]."""
    by_slip: float
    """Derivative of friction by the slip at constant bound [N/m]."""
    by_pull: float
    """Derivative of friction by the tension on the pull side [-]."""
    upper: float
    """Eliminated system: coefficient of the next pulley's step [-]."""


PULLEY: Final = record_type(PulleyNumbers)
SOLVER_ELEMENT: Final = record_type(SolverElement)
CONTACT: Final = record_type(Contact)

MAX_ITERATIONS: Final = 40
MAX_SUBSTEPS: Final = 256
HARDNESS: Final = (1e-6, 1e-4, 1e-2, 1.0)
"""Factors of the bristles' stiffness with which a difficult sample is solved one after another."""
SMALLEST_SHRINK: Final = 0.25
"""A Newton step may not shorten an element below this share of its material."""


@lean
def tolerance(elastic: Elasticity) -> float:
    """Largest force imbalance of a solved pulley [N]; the second term allows for rounding."""
    return 1e-8 + 1e-14 * float(elastic.axial_stiffness)


@lean
def acceptable(elastic: Elasticity) -> float:
    """Largest force imbalance of a usable sample [N]; with a larger one it counts as unsolved."""
    return 1e-4 + 1e-14 * float(elastic.axial_stiffness)


@lean
def element_tension(elastic: Elasticity, length: float, material: float) -> float:
    """Tension of an element [N]; exact for any amount of winding; (11) is its linearisation.

    It is EA max(L / l - 1, 0) in a linear cable (E1), (E21) in one that stiffens.
    """
    strain = length / material - 1.0
    if elastic.bedding_strain != 0.0 and strain > 0.0:
        return stiffened_tension(elastic, strain)
    return max(elastic.axial_stiffness * strain, 0.0)


@stage
def _friction(
    contact: Contact,
    pulley: PulleyNumbers,
    hardness: float,
    slip: float,
    pull: float,
    law: int,
    dt: float,
) -> tuple[float, float, float]:
    """Friction of a pulley [N], its derivatives by the slip [N/m] and by the pull side's tension.

    The function writes the bristle force and the bound of the contact.
    """
    bound = contact.loss * pull + pulley.drag + BOUND_FLOOR
    stiffness = pulley.bristle_stiffness * hardness
    bristle_before = contact.bristle_before
    force, by_slip, by_bound = friction_force(
        law, bristle_before, slip, stiffness, bound, pulley.breakaway
    )
    contact.bristle = force
    contact.bound = bound
    by_pull = by_bound * contact.loss
    if dt > 0.0:
        damping = pulley.bristle_damping
        if damping != 0.0:
            # sigma1 dz/dt; sigma1 fades with speed: with a constant one LuGre is not passive
            rate = damping * contact.static_share / (pulley.bristle_stiffness * dt)
            force += rate * (force - bristle_before)
            by_slip *= 1.0 + rate
            by_pull *= 1.0 + rate
        viscous = pulley.viscous / dt
        force += viscous * slip
        by_slip += viscous
    return force, by_slip, by_pull


@lean
def _balance(
    elastic: Elasticity,
    elements: Rows[SolverElement],
    contacts: Rows[Contact],
    pulleys: Rows[PulleyNumbers],
    hardness: float,
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> float:
    """Force imbalance of every pulley at its trial slip; returns the largest magnitude [N].

    Residual i is (t_{i+1} - t_i) - friction_i.  The function writes material and tension of the
    elements, and bristle force, bound, residual and derivatives of friction of the contacts.
    ``hardness`` is a factor of the bristles' stiffness.

    Takes 9 arguments, those of ``solve_cable`` and the hardness.
    """
    n = len(contacts)
    worst = 0.0
    slip = contacts[0].trial
    material = elements[0].material_before + first_slip - slip
    elements[0].material = material
    t_left = element_tension(elastic, elements[0].length, material)
    elements[0].tension = t_left
    for i in range(n):
        following = contacts[i + 1].trial if i + 1 < n else last_slip
        material = elements[i + 1].material_before + slip - following
        elements[i + 1].material = material
        t_right = element_tension(elastic, elements[i + 1].length, material)
        elements[i + 1].tension = t_right
        force, by_slip, by_pull = 0.0, 0.0, 0.0
        if law != NONE:
            pull = max(t_left, t_right)
            force, by_slip, by_pull = _friction(
                contacts[i], pulleys[i], hardness, slip, pull, law, dt
            )
        contacts[i].by_slip = by_slip
        contacts[i].by_pull = by_pull
        residual = t_right - t_left - force
        contacts[i].residual = residual
        if not abs(residual) <= worst:  # true for NaN too
            worst = abs(residual)
        t_left = t_right
        slip = following
    return worst


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


@lean
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


@lean
def _shortened(share: float, change: float, material: float) -> float:
    """Limit the fraction of a step so that an element keeps some material.

    Args:
        share: fraction of the step so far.
        change: change of the element's material by the whole step [m].
        material: the element's material [m].
    """
    most = (SMALLEST_SHRINK - 1.0) * material
    return min(share, most / change) if change < most else share


@lean
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
def _predict(
    contacts: Rows[Contact], elements: Rows[SolverElement], first_slip: float, last_slip: float
) -> None:
    """Slips that scale the stretch L / l of every element by one factor, which fits the material.

    A start from the previous slips instead can shrink short elements to zero length.
    """
    n = len(contacts)
    kept = 0.0
    total = first_slip - last_slip
    for e in range(n + 1):
        before = elements[e].material_before
        kept += before * (elements[e].length / elements[e].length_before)
        total += before
    scale = total / kept
    passing = first_slip
    for i in range(n):
        before = elements[i].material_before
        passing += before * (1.0 - elements[i].length / elements[i].length_before * scale)
        contacts[i].slip = passing


@lean
def _newton(
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
    """Newton's method with a line search from the slips in ``contacts``.

    Returns:
        Iterations and the largest remaining force imbalance [N].

    Takes 9 arguments, see ``_balance``.
    """
    n = len(contacts)
    enough = tolerance(elastic)
    for i in range(n):
        contacts[i].trial = contacts[i].slip
    worst = _balance(elastic, elements, contacts, pulleys, hardness, first_slip, last_slip, law, dt)
    for iteration in range(MAX_ITERATIONS):
        if worst <= enough:
            return iteration, worst
        share = _newton_step(elastic, elements, contacts)
        best = worst
        for _ in range(6):
            _try_step(contacts, pulleys, hardness, law, share)
            worst = _balance(
                elastic, elements, contacts, pulleys, hardness,
                first_slip, last_slip, law, dt,
            )  # fmt: skip
            if worst < best:
                break
            share *= 0.5
        for i in range(n):
            contacts[i].slip = contacts[i].trial
    return MAX_ITERATIONS, worst


@lean
def _guess_is_usable(
    contacts: Rows[Contact], elements: Rows[SolverElement], first_slip: float, last_slip: float
) -> bool:
    """Whether the slips in ``contacts`` leave every element half of its material."""
    n = len(contacts)
    incoming = first_slip
    for e in range(n + 1):
        outgoing = contacts[e].slip if e < n else last_slip
        if incoming - outgoing < -0.5 * elements[e].material_before:
            return False
        incoming = outgoing
    return True


@lean
def solve_cable(
    elastic: Elasticity,
    elements: Rows[SolverElement],
    contacts: Rows[Contact],
    pulleys: Rows[PulleyNumbers],
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Advance one cable of n pulleys by one sample.

    Args:
        elastic: tension-strain law of the cable.
        elements: shape (n + 1,); the lengths before and now and the material before are given;
            material and tension are written.
        contacts: shape (n,); a first guess of the slip, the bristle force before, the loss and the
            share of static friction in it are given; slip and bristle force are written; the
            rest is scratch.
        pulleys: constants of the pulleys, shape (n,).
        first_slip, last_slip: material that enters at the first and leaves at the last node [m].
        law: code of the friction law.
        dt: duration of the sample [s]; 0 where unknown (speeds then count as zero).

    Returns:
        Total number of Newton iterations and the largest remaining force imbalance [N].  Unless
        this is within ``acceptable``, the sample is not solved, and the caller must report it.
    """
    if len(contacts) == 0:
        material = elements[0].material_before + first_slip - last_slip
        elements[0].material = material
        elements[0].tension = element_tension(elastic, elements[0].length, material)
        return 0, 0.0
    enough = tolerance(elastic)
    # In steady motion the given guess is better; in all other cases the predictor is.
    iterations = 0
    if _guess_is_usable(contacts, elements, first_slip, last_slip):
        iterations, worst = _newton(
            elastic, elements, contacts, pulleys, 1.0, first_slip, last_slip, law, dt
        )
        if worst <= enough:
            return iterations, worst
    _predict(contacts, elements, first_slip, last_slip)
    count, worst = _newton(
        elastic, elements, contacts, pulleys, 1.0, first_slip, last_slip, law, dt
    )
    iterations += count
    pieces: Any = np.int64(4)  # a literal has its own type: numba would compile _walk twice
    while not worst <= enough and pieces <= MAX_SUBSTEPS:
        count, worst = _walk(
            pieces, elastic, elements, contacts, pulleys, first_slip, last_slip, law, dt
        )
        iterations += count
        pieces *= 4
    if not worst <= acceptable(elastic):
        count, worst = _harden(elastic, elements, contacts, pulleys, first_slip, last_slip, law, dt)
        iterations += count
    return iterations, worst


@lean
def _harden(
    elastic: Elasticity,
    elements: Rows[SolverElement],
    contacts: Rows[Contact],
    pulleys: Rows[PulleyNumbers],
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Solve a sample with soft bristles first, then with harder and harder ones.

    Where a long cable begins to slip on thousands of pulleys at once, Newton's method finds a few
    of them per iteration.  Soft bristles spread the transition from slip to stick over many
    pulleys, so that a few iterations find it, and stiffening them narrows it: (E23).

    Returns:
        Newton iterations and the largest force imbalance with the true stiffness [N].
    """
    iterations, worst = 0, 0.0
    _predict(contacts, elements, first_slip, last_slip)
    for hardness in HARDNESS:
        count, worst = _newton(
            elastic, elements, contacts, pulleys, hardness, first_slip, last_slip, law, dt
        )
        iterations += count
    return iterations, worst


@compiled
def _walk(
    pieces: int,
    elastic: Elasticity,
    elements: Rows[SolverElement],
    contacts: Rows[Contact],
    pulleys: Rows[PulleyNumbers],
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Solve a sample that is too large for one step in equal pieces along the straight path.

    Returns:
        Newton iterations and the largest force imbalance of any piece [N].  Above ``acceptable``
        the remaining pieces were not solved and the slips are not those of the sample.

    Takes 9 arguments because it passes the 8 of ``solve_cable`` on, piece by piece.
    """
    n = len(contacts)
    start, end, material = np.empty(n + 1), np.empty(n + 1), np.empty(n + 1)
    for e in range(n + 1):
        start[e], end[e] = elements[e].length_before, elements[e].length
        material[e] = elements[e].material_before
    bristle, slip = np.empty(n), np.zeros(n)
    for i in range(n):
        bristle[i] = contacts[i].bristle_before
    iterations, worst = 0, 0.0
    for piece in range(pieces):
        for e in range(n + 1):
            way = end[e] - start[e]
            elements[e].length_before = start[e] + way * (piece / pieces)
            elements[e].length = start[e] + way * ((piece + 1) / pieces)
        _predict(contacts, elements, first_slip / pieces, last_slip / pieces)
        count, left = _newton(
            elastic, elements, contacts, pulleys, 1.0,
            first_slip / pieces, last_slip / pieces, law, dt / pieces,
        )  # fmt: skip
        iterations += count
        if not left <= worst:  # true for NaN too
            worst = left
        if not left <= acceptable(elastic):  # leave out the remaining pieces
            break
        for e in range(n + 1):
            elements[e].material_before = elements[e].material
        for i in range(n):
            slip[i] += contacts[i].slip
            contacts[i].bristle_before = contacts[i].bristle
    for e in range(n + 1):
        elements[e].length_before, elements[e].length = start[e], end[e]
        elements[e].material_before = material[e]
    for i in range(n):
        contacts[i].bristle_before, contacts[i].slip = bristle[i], slip[i]
    return iterations, worst
