"""An assumed friction history for a cable whose previous motion is unknown."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.balance import element_tension
from cdrj_ros.model.compiled import lean
from cdrj_ros.model.elasticity import elasticity_of, modulus_at, strain_at
from cdrj_ros.model.friction import NONE
from cdrj_ros.model.packing import Indices, number_views, plan_views
from cdrj_ros.model.state import scratch_views, state_views

Vector = NDArray[np.float64]

MOST_ROUNDS: Final = 12
"""Newton steps for the common factor of a stiffening cable's tensions; a linear one needs 3."""


@lean
def impose_friction(
    plan: Indices, numbers: Vector, share: Vector, state: Vector, scratch: Vector
) -> None:
    """Impose a friction history on a robot that has just been started; keep the elongations.

    Longer than a screen because the ratios of the tensions, their common factor and the material
    all follow from one walk along each cable.

    Args:
        plan, numbers: the prepared robot.
        share: friction as a share of every pulley's bound, in [-1, 1], positive where the tension
            rises towards the last node, shape (pulleys,).
        state: the state that ``advance`` wrote for the first sample; changed.
        scratch: the scratch that ``advance`` wrote, with the loss of every pulley; changed.
    """
    parts = plan_views(plan)
    constants = number_views(parts.sizes, numbers)
    after, work = state_views(parts.sizes, state), scratch_views(parts.sizes, scratch)
    length, material = after.length, after.material
    for c in range(len(parts.cables)):
        cable, elastic = parts.cables[c], elasticity_of(constants.cables[c])
        first = cable.first_contact + c
        last = first + cable.contacts + 1
        if cable.law == NONE:
            continue
        total = 0.0
        span = 0.0
        for e in range(first, last):
            total += material[e]
            span += length[e]
        mean = element_tension(elastic, span, total)
        if not mean > 0.0:
            continue
        # compute the ratios of the tensions, then the common factor that keeps the elongation
        ratio = 1.0
        work.segments[first].tension = ratio
        weighted = length[first]
        for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
            own = parts.pulleys[p]
            for q in range(own.first_contact, own.first_contact + own.cells):
                contact = work.contacts[q]
                hold = 1.0 - contact.loss - contact.drag / (mean + contact.drag)
                ratio *= max(hold, 1e-3) ** (-share[p])
                work.segments[q + c + 1].tension = ratio
                weighted += length[q + c + 1] * ratio
        scale = mean * span / weighted
        for _ in range(3 if elastic.bedding_strain == 0.0 else MOST_ROUNDS):
            held = 0.0
            slope = 0.0
            for e in range(first, last):
                ratio = work.segments[e].tension
                stretch = 1.0 + strain_at(elastic, scale * ratio)
                modulus = modulus_at(elastic, scale * ratio)
                held += length[e] / stretch
                slope -= length[e] * ratio / (modulus * stretch * stretch)
            scale -= (held - total) / slope
        for e in range(first, last):
            ratio = work.segments[e].tension
            material[e] = length[e] / (1.0 + strain_at(elastic, scale * ratio))
            if e > first:
                after.bristle[e - 1 - c] = scale * (ratio - work.segments[e - 1].tension)
