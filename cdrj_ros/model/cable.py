"""One sample of one cable: all its pulleys solved together.

Newton's method starts from the slips of the sample before or from a prediction; samples that are
too large for it are solved in pieces, or with bristles that start soft.  See docs/model.md,
section 4.
"""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np

from cdrj_ros.model.balance import acceptable, element_tension, tolerance
from cdrj_ros.model.cable_records import (
    CONTACT,
    PULLEY,
    SOLVER_ELEMENT,
    Contact,
    PulleyNumbers,
    SolverElement,
)
from cdrj_ros.model.compiled import callee, compiled, lean
from cdrj_ros.model.elasticity import Elasticity
from cdrj_ros.model.linked import linked
from cdrj_ros.model.newton import newton
from cdrj_ros.model.records import Rows
from cdrj_ros.model.view_type import View

MAX_SUBSTEPS: Final = 256
HARDNESS: Final = (1e-6, 1e-4, 1e-2, 1.0)
"""Factors of the bristles' stiffness with which a difficult sample is solved one after another."""


@callee
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


@callee
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
    """Advance one cable of n pulleys by one sample: (E11), in the stages of (E23) where it is hard.

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
        iterations, worst = newton(
            elastic, elements, contacts, pulleys, 1.0, first_slip, last_slip, law, dt
        )
        if worst <= enough:
            return iterations, worst
    _predict(contacts, elements, first_slip, last_slip)
    count, worst = newton(elastic, elements, contacts, pulleys, 1.0, first_slip, last_slip, law, dt)
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


def _signature() -> Any:
    """Types of ``solve_cable`` when the step of a robot calls it."""
    elements, contacts = (
        View(numba.from_dtype(kind), 1, True) for kind in (SOLVER_ELEMENT, CONTACT)
    )
    pulleys = View(numba.from_dtype(PULLEY), 1, False)
    kinds: Any = numba.types
    number, code = kinds.float64, kinds.int64
    elastic = kinds.NamedUniTuple(number, 3, Elasticity)
    result = kinds.Tuple((code, number))
    return result(elastic, elements, contacts, pulleys, number, number, code, number)


_SIGNATURE: Final = _signature()

solve_cable_linked: Final = linked(solve_cable, _SIGNATURE)
"""``solve_cable``, to be called by kernels."""


def compile_solve_cable() -> None:
    """Compile ``solve_cable`` for ``solve_cable_linked``, or load it."""
    dispatcher: Any = solve_cable
    if hasattr(dispatcher, "overloads"):  # compilation is not switched off
        dispatcher.compile(_SIGNATURE.args)


@callee
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
        count, worst = newton(
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
        count, left = newton(
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
