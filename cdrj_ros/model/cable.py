"""One sample of one cable: all its contacts solved together.

Newton's method starts from the fluxes of the sample before or from a prediction; samples that are
too large for it are solved in pieces, or with bristles that start soft.  See docs/model.md,
section 5.
"""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np

from cdrj_ros.model.balance import acceptable, element_tension, tolerance
from cdrj_ros.model.cable_records import CONTACT, SEGMENT, Contact, Segment
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
    contacts: Rows[Contact], segments: Rows[Segment], first_flux: float, last_flux: float
) -> None:
    """Fluxes that scale the stretch L / l of every segment by one factor, which fits the material.

    A start from the previous fluxes instead can shrink short segments to zero length.
    """
    n = len(contacts)
    kept = 0.0
    total = first_flux - last_flux
    for e in range(n + 1):
        before = segments[e].material_before
        kept += before * (segments[e].length / segments[e].length_before)
        total += before
    scale = total / kept
    passing = first_flux
    for i in range(n):
        before = segments[i].material_before
        passing += before * (1.0 - segments[i].length / segments[i].length_before * scale)
        contacts[i].flux = passing


@callee
def _guess_is_usable(
    contacts: Rows[Contact], segments: Rows[Segment], first_flux: float, last_flux: float
) -> bool:
    """Whether the fluxes in ``contacts`` leave every segment half of its material."""
    n = len(contacts)
    incoming = first_flux
    for e in range(n + 1):
        outgoing = contacts[e].flux if e < n else last_flux
        if incoming - outgoing < -0.5 * segments[e].material_before:
            return False
        incoming = outgoing
    return True


@lean
def solve_cable(
    elastic: Elasticity,
    segments: Rows[Segment],
    contacts: Rows[Contact],
    first_flux: float,
    last_flux: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Advance one cable of n contacts by one sample: (E11), or the stages of (E23).

    Args:
        elastic: tension-strain law of the cable.
        segments: shape (n + 1,); the lengths before and now and the material before are given;
            material and tension are written.
        contacts: shape (n,); constants, a first guess of the flux, the shift, the bristle force
            before, the loss and the share of static friction in it are given; flux and bristle
            force are written; the rest is scratch.
        first_flux, last_flux: material that enters at the first and leaves at the last node [m].
        law: code of the friction law.
        dt: duration of the sample [s]; 0 where unknown (speeds then count as zero).

    Returns:
        Total number of Newton iterations and the largest remaining force imbalance [N].  Unless
        this is within ``acceptable``, the sample is not solved, and the caller must report it.
    """
    if len(contacts) == 0:
        material = segments[0].material_before + first_flux - last_flux
        segments[0].material = material
        segments[0].tension = element_tension(elastic, segments[0].length, material)
        return 0, 0.0
    enough = tolerance(elastic)
    # In steady motion the given guess is better; in all other cases the predictor is.
    iterations = 0
    if _guess_is_usable(contacts, segments, first_flux, last_flux):
        iterations, worst = newton(elastic, segments, contacts, 1.0, first_flux, last_flux, law, dt)
        if worst <= enough:
            return iterations, worst
    _predict(contacts, segments, first_flux, last_flux)
    count, worst = newton(elastic, segments, contacts, 1.0, first_flux, last_flux, law, dt)
    iterations += count
    pieces: Any = np.int64(4)  # a literal has its own type: numba would compile _walk twice
    while not worst <= enough and pieces <= MAX_SUBSTEPS:
        count, worst = _walk(pieces, elastic, segments, contacts, first_flux, last_flux, law, dt)
        iterations += count
        pieces *= 4
    if not worst <= acceptable(elastic):
        count, worst = _harden(elastic, segments, contacts, first_flux, last_flux, law, dt)
        iterations += count
    return iterations, worst


def _signature() -> Any:
    """Types of ``solve_cable`` when the step of a robot calls it."""
    segments, contacts = (View(numba.from_dtype(kind), 1, True) for kind in (SEGMENT, CONTACT))
    kinds: Any = numba.types
    number, code = kinds.float64, kinds.int64
    elastic = kinds.NamedUniTuple(number, 3, Elasticity)
    result = kinds.Tuple((code, number))
    return result(elastic, segments, contacts, number, number, code, number)


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
    segments: Rows[Segment],
    contacts: Rows[Contact],
    first_flux: float,
    last_flux: float,
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
    _predict(contacts, segments, first_flux, last_flux)
    for hardness in HARDNESS:
        count, worst = newton(elastic, segments, contacts, hardness, first_flux, last_flux, law, dt)
        iterations += count
    return iterations, worst


@compiled
def _walk(
    pieces: int,
    elastic: Elasticity,
    segments: Rows[Segment],
    contacts: Rows[Contact],
    first_flux: float,
    last_flux: float,
    law: int,
    dt: float,
) -> tuple[int, float]:
    """Solve a sample that is too large for one step in equal pieces along the straight path.

    Returns:
        Newton iterations and the largest force imbalance of any piece [N].  Above ``acceptable``
        the remaining pieces were not solved and the fluxes are not those of the sample.
    """
    n = len(contacts)
    start, end, material = np.empty(n + 1), np.empty(n + 1), np.empty(n + 1)
    for e in range(n + 1):
        start[e], end[e] = segments[e].length_before, segments[e].length
        material[e] = segments[e].material_before
    bristle, shift, flux = np.empty(n), np.empty(n), np.zeros(n)
    for i in range(n):
        bristle[i], shift[i] = contacts[i].bristle_before, contacts[i].shift
        contacts[i].shift = shift[i] / pieces
    iterations, worst = 0, 0.0
    for piece in range(pieces):
        for e in range(n + 1):
            way = end[e] - start[e]
            segments[e].length_before = start[e] + way * (piece / pieces)
            segments[e].length = start[e] + way * ((piece + 1) / pieces)
        _predict(contacts, segments, first_flux / pieces, last_flux / pieces)
        count, left = newton(
            elastic, segments, contacts, 1.0,
            first_flux / pieces, last_flux / pieces, law, dt / pieces,
        )  # fmt: skip
        iterations += count
        if not left <= worst:  # true for NaN too
            worst = left
        if not left <= acceptable(elastic):  # leave out the remaining pieces
            break
        for e in range(n + 1):
            segments[e].material_before = segments[e].material
        for i in range(n):
            flux[i] += contacts[i].flux
            contacts[i].bristle_before = contacts[i].bristle
    for e in range(n + 1):
        segments[e].length_before, segments[e].length = start[e], end[e]
        segments[e].material_before = material[e]
    for i in range(n):
        contacts[i].bristle_before, contacts[i].shift = bristle[i], shift[i]
        contacts[i].flux = flux[i]
    return iterations, worst
