"""One sample of one cable: all its pulleys solved together.

A cable of n nodes has n - 1 elements and n - 2 pulleys.  Arrays count elements and pulleys from 0:
pulley ``i`` lies between elements ``i`` and ``i + 1``.  Unknown is the slip of every pulley, the
unstretched material that moves past it towards the last node.  docs/model.md, sections 2 to 4.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import compiled
from cdrj_ros.model.friction import BOUND_FLOOR, LUGRE, NONE, friction_force

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

# Columns of a pulley's row: what friction needs to know, constant over a run.
(
    RADIUS,
    RHO,
    MU_C,
    MU_S,
    STRIBECK_SPEED,
    BEARING_RATIO,
    DRAG,
    BRISTLE_STIFFNESS,
    BRISTLE_DAMPING,
    VISCOUS,
    BREAKAWAY,
    STRIBECK_LAG,
    CELLS,
    PULLEY_COLUMNS,
) = range(14)

# Columns of an element's row in the solver.
LENGTH_BEFORE, LENGTH, MATERIAL_BEFORE, MATERIAL, TENSION, ELEMENT_COLUMNS = range(6)

# Columns of a pulley's row in the solver.
(
    SLIP,
    BRISTLE_BEFORE,
    BRISTLE,
    LOSS,
    STATIC_SHARE,
    _BOUND,
    _TRIAL,
    _STEP,
    _RESIDUAL,
    _LOWER,
    _DIAGONAL,
    _UPPER,
    WORK_COLUMNS,
) = range(13)

MAX_ITERATIONS: Final = 40
MAX_SUBSTEPS: Final = 256
SMALLEST_SHRINK: Final = 0.25
"""A Newton step may not shorten an element below this share of its material."""


@compiled
def tolerance(axial_stiffness: float) -> float:
    """Largest force imbalance at a pulley that counts as solved [N]; rounding sets the floor."""
    return 1e-8 + 1e-14 * axial_stiffness


@compiled
def acceptable(axial_stiffness: float) -> float:
    """Largest force imbalance with which a sample may be used [N]; above, it is not solved."""
    return 1e-4 + 1e-14 * axial_stiffness


@compiled
def element_tension(axial_stiffness: float, length: float, material: float) -> float:
    """t = EA max(L / l - 1, 0) [N]; exact for large winding, (11) is its linearisation."""
    return max(axial_stiffness * (length / material - 1.0), 0.0)


@compiled
def _imbalance(
    column: int,
    axial_stiffness: float,
    elements: Table,
    work: Table,
    pulleys: Table,
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> float:
    """Force imbalance of every pulley at the slips in ``work[:, column]``, with its Jacobian.

    Residual i is (t_{i+1} - t_i) - friction_i, tridiagonal in the slips.  The bound of friction
    follows the pull side, so its derivative stands in a neighbour's column too.  Fills material,
    tension, bristle force, bound, residual and Jacobian; returns the largest |residual| [N].
    """
    n = work.shape[0]
    worst = 0.0
    slip = work[0, column]
    material = elements[0, MATERIAL_BEFORE] + first_slip - slip
    elements[0, MATERIAL] = material
    stretch = elements[0, LENGTH] / material
    t_left = axial_stiffness * (stretch - 1.0)
    k_left = axial_stiffness * stretch / material
    if t_left <= 0.0:
        t_left, k_left = 0.0, 0.0
    elements[0, TENSION] = t_left
    for i in range(n):
        following = work[i + 1, column] if i + 1 < n else last_slip
        material = elements[i + 1, MATERIAL_BEFORE] + slip - following
        elements[i + 1, MATERIAL] = material
        stretch = elements[i + 1, LENGTH] / material
        t_right = axial_stiffness * (stretch - 1.0)
        k_right = axial_stiffness * stretch / material
        if t_right <= 0.0:
            t_right, k_right = 0.0, 0.0
        elements[i + 1, TENSION] = t_right

        force = 0.0
        by_slip = 0.0
        by_pull = 0.0
        if law != NONE:
            eta_loss = work[i, LOSS]
            bound = eta_loss * max(t_left, t_right) + pulleys[i, DRAG] + BOUND_FLOOR
            stiffness = pulleys[i, BRISTLE_STIFFNESS]
            bristle_before = work[i, BRISTLE_BEFORE]
            force, by_slip, by_bound = friction_force(
                law, bristle_before, slip, stiffness, bound, pulleys[i, BREAKAWAY]
            )
            work[i, BRISTLE] = force
            work[i, _BOUND] = bound
            by_pull = by_bound * eta_loss
            if dt > 0.0:
                damping = pulleys[i, BRISTLE_DAMPING]
                if damping != 0.0:
                    # sigma1 dz/dt, fading with speed: constant, it costs LuGre its passivity
                    rate = damping * work[i, STATIC_SHARE] / (stiffness * dt)
                    force += rate * (force - bristle_before)
                    by_slip *= 1.0 + rate
                    by_pull *= 1.0 + rate
                viscous = pulleys[i, VISCOUS] / dt
                force += viscous * slip
                by_slip += viscous

        residual = t_right - t_left - force
        work[i, _RESIDUAL] = residual
        if not abs(residual) <= worst:  # true for NaN too
            worst = abs(residual)
        lower, upper = k_left, k_right
        diagonal = -(k_left + k_right) - by_slip
        # Slack elements carry no stiffness.  A little of it in the matrix, not in the residual,
        # keeps a taut element between slack neighbours from making the system singular.
        slack = 1e-3 * axial_stiffness / material
        if k_left == 0.0:
            diagonal -= slack
        if k_right == 0.0:
            diagonal -= slack
        if t_right >= t_left:
            diagonal += by_pull * k_right
            upper -= by_pull * k_right
        else:
            diagonal -= by_pull * k_left
            lower += by_pull * k_left
        work[i, _LOWER] = lower
        work[i, _DIAGONAL] = diagonal
        work[i, _UPPER] = upper
        t_left, k_left = t_right, k_right
        slip = following
    return worst


@compiled
def _newton_step(work: Table) -> None:
    """Solve the tridiagonal system J step = -residual in place (Thomas), O(n)."""
    n = work.shape[0]
    scale = 1.0 / work[0, _DIAGONAL]
    work[0, _UPPER] *= scale
    work[0, _STEP] = -work[0, _RESIDUAL] * scale
    for i in range(1, n):
        scale = 1.0 / (work[i, _DIAGONAL] - work[i, _LOWER] * work[i - 1, _UPPER])
        work[i, _UPPER] *= scale
        work[i, _STEP] = (-work[i, _RESIDUAL] - work[i, _LOWER] * work[i - 1, _STEP]) * scale
    for i in range(n - 2, -1, -1):
        work[i, _STEP] -= work[i, _UPPER] * work[i + 1, _STEP]


@compiled
def _longest_step(work: Table, elements: Table) -> float:
    """Share in (0, 1] of the Newton step that leaves every element some material."""
    n = work.shape[0]
    share = 1.0
    incoming = 0.0
    for e in range(n + 1):
        outgoing = work[e, _STEP] if e < n else 0.0
        change = incoming - outgoing
        most = (SMALLEST_SHRINK - 1.0) * elements[e, MATERIAL]
        if change < most:
            share = min(share, most / change)
        incoming = outgoing
    return share


@compiled
def _try_step(work: Table, pulleys: Table, law: int, share: float) -> None:
    """Write slip + share * step into the trial column, stopping inside a stick that is crossed.

    Between sliding forward and sliding back lies the elastic range of the bristles.  A step that
    jumps over it would flip the friction from one bound to the other, and back in the next
    iteration; it is stopped where the bristle force is zero.
    """
    for i in range(work.shape[0]):
        slip = work[i, SLIP]
        trial = slip + share * work[i, _STEP]
        if law not in (NONE, LUGRE):
            stiffness = pulleys[i, BRISTLE_STIFFNESS]
            before = work[i, BRISTLE_BEFORE]
            old, new = before + stiffness * slip, before + stiffness * trial
            bound = work[i, _BOUND]
            if (old > bound and new < -bound) or (old < -bound and new > bound):
                trial = -before / stiffness
        elif law == LUGRE and slip * trial < 0.0:  # the slope jumps where the slip turns
            trial *= 0.3
        work[i, _TRIAL] = trial


@compiled
def _predict(work: Table, elements: Table, first_slip: float, last_slip: float) -> None:
    """Slips that keep every element's strain, the winch's demand spread in proportion to length.

    Starting from the last slips instead can drive short elements to zero length.
    """
    n = work.shape[0]
    kept = 0.0
    total = first_slip - last_slip
    for e in range(n + 1):
        before = elements[e, MATERIAL_BEFORE]
        kept += before * (elements[e, LENGTH] / elements[e, LENGTH_BEFORE])
        total += before
    scale = total / kept
    passing = first_slip
    for i in range(n):
        before = elements[i, MATERIAL_BEFORE]
        passing += before * (1.0 - elements[i, LENGTH] / elements[i, LENGTH_BEFORE] * scale)
        work[i, SLIP] = passing


@compiled
def _newton(
    axial_stiffness: float,
    elements: Table,
    work: Table,
    pulleys: Table,
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Newton's method with a line search from the slips in ``work``; (iterations, residual)."""
    n = work.shape[0]
    enough = tolerance(axial_stiffness)
    worst = _imbalance(
        SLIP, axial_stiffness, elements, work, pulleys, first_slip, last_slip, law, dt
    )
    for iteration in range(MAX_ITERATIONS):
        if worst <= enough:
            return iteration, worst
        _newton_step(work)
        share = _longest_step(work, elements)
        best = worst
        for _ in range(6):
            _try_step(work, pulleys, law, share)
            worst = _imbalance(
                _TRIAL, axial_stiffness, elements, work, pulleys, first_slip, last_slip, law, dt
            )
            if worst < best:
                break
            share *= 0.5
        for i in range(n):
            work[i, SLIP] = work[i, _TRIAL]
    return MAX_ITERATIONS, worst


@compiled
def _guess_is_usable(work: Table, elements: Table, first_slip: float, last_slip: float) -> bool:
    """Whether the slips in ``work`` leave every element half of its material."""
    n = work.shape[0]
    incoming = first_slip
    for e in range(n + 1):
        outgoing = work[e, SLIP] if e < n else last_slip
        if incoming - outgoing < -0.5 * elements[e, MATERIAL_BEFORE]:
            return False
        incoming = outgoing
    return True


@compiled
def solve_cable(
    axial_stiffness: float,
    elements: Table,
    work: Table,
    pulleys: Table,
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Advance one cable of n pulleys by one sample.

    Args:
        axial_stiffness: EA [N].
        elements: rows of the elements, shape (n + 1, ELEMENT_COLUMNS); given are the lengths
            before and now and the material before [m], written are material and tension [N].
        work: rows of the pulleys, shape (n, WORK_COLUMNS); given are a first guess of the slip
            [m], the bristle force before [N], the loss 1 - eta and the share of static friction
            in it, written are slip and bristle force; the rest is scratch.
        pulleys: constants of the pulleys, shape (n, PULLEY_COLUMNS).
        first_slip, last_slip: material that enters at the first and leaves at the last node [m].
        law: code of the friction law.
        dt: duration of the sample [s]; 0 where unknown (speeds then count as zero).

    Returns:
        Newton iterations in all and the largest remaining force imbalance [N].  The sample is
        solved where that is within ``acceptable``; otherwise the caller must report it.
    """
    n = work.shape[0]
    if n == 0:
        material = elements[0, MATERIAL_BEFORE] + first_slip - last_slip
        elements[0, MATERIAL] = material
        elements[0, TENSION] = element_tension(axial_stiffness, elements[0, LENGTH], material)
        return 0, 0.0
    enough = tolerance(axial_stiffness)

    # The given guess is the better one in steady motion, the predictor everywhere else.
    iterations = 0
    if _guess_is_usable(work, elements, first_slip, last_slip):
        iterations, worst = _newton(
            axial_stiffness, elements, work, pulleys, first_slip, last_slip, law, dt
        )
        if worst <= enough:
            return iterations, worst
    _predict(work, elements, first_slip, last_slip)
    count, worst = _newton(axial_stiffness, elements, work, pulleys, first_slip, last_slip, law, dt)
    iterations += count
    pieces = 4
    while not worst <= enough and pieces <= MAX_SUBSTEPS:
        count, worst = _walk(
            pieces, axial_stiffness, elements, work, pulleys, first_slip, last_slip, law, dt
        )
        iterations += count
        pieces *= 4
    return iterations, worst


@compiled
def _walk(
    pieces: int,
    axial_stiffness: float,
    elements: Table,
    work: Table,
    pulleys: Table,
    first_slip: float,
    last_slip: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """A sample too large for one step, walked on the straight path in equal pieces.

    Returns:
        Newton iterations and the largest force imbalance of any piece [N].  Above ``acceptable``
        the way was given up and the slips are not those of the sample.
    """
    n = work.shape[0]
    start, end = elements[:, LENGTH_BEFORE].copy(), elements[:, LENGTH].copy()
    material, bristle = elements[:, MATERIAL_BEFORE].copy(), work[:, BRISTLE_BEFORE].copy()
    slip = np.zeros(n)
    iterations, worst = 0, 0.0
    for piece in range(pieces):
        elements[:, LENGTH_BEFORE] = start + (end - start) * (piece / pieces)
        elements[:, LENGTH] = start + (end - start) * ((piece + 1) / pieces)
        _predict(work, elements, first_slip / pieces, last_slip / pieces)
        count, left = _newton(
            axial_stiffness,
            elements,
            work,
            pulleys,
            first_slip / pieces,
            last_slip / pieces,
            law,
            dt / pieces,
        )
        iterations += count
        if not left <= worst:  # true for NaN too
            worst = left
        if not left <= acceptable(axial_stiffness):  # the rest of the way is not walked
            break
        slip += work[:, SLIP]
        elements[:, MATERIAL_BEFORE] = elements[:, MATERIAL]
        work[:, BRISTLE_BEFORE] = work[:, BRISTLE]
    elements[:, LENGTH_BEFORE], elements[:, LENGTH] = start, end
    elements[:, MATERIAL_BEFORE], work[:, BRISTLE_BEFORE] = material, bristle
    work[:, SLIP] = slip
    return iterations, worst
