"""Contact cells of pulleys, their places on the bodies, and slip against the bodies.

See docs/model.md, section 4.
"""

from __future__ import annotations

from math import pi
from typing import Final

from cdrj_ros.model.cable_records import Contact, PulleyNumbers
from cdrj_ros.model.compiled import stage
from cdrj_ros.model.packing import SPATIAL, Numbers, Plan
from cdrj_ros.model.spatial_middle import motion_along
from cdrj_ros.model.state import ScratchViews, StateViews

SHORTEST_SEGMENT: Final = 1e-6
"""Length of the segments between cells of a body that the cable does not touch [m]."""


@stage
def span_segment(plan: Plan, c: int, k: int) -> int:
    """The segment of cable c that holds the free span of its element k."""
    cable = plan.cables[c]
    if k == 0:
        return cable.first_contact + c
    pulley = plan.pulleys[cable.first_pulley + k - 1]
    return pulley.first_contact + pulley.cells + c


@stage
def middle_to_outer(arc: float, cells: int) -> float:
    """Cable from the middle of an arc to the middle of the last of its equal cells [m]."""
    return 0.5 * max(arc / cells, SHORTEST_SEGMENT) * (cells - 1)


@stage
def divide_arcs(plan: Plan, scratch: ScratchViews) -> None:
    """Lengths of the segments from those of the elements: the arc of every pulley in equal cells.

    An element ends in the middle of an arc, its outer segment in the middle of the first cell.
    """
    for c in range(len(plan.cables)):
        cable = plan.cables[c]
        for k in range(cable.elements):
            length = scratch.element_length[cable.first_element + k]
            scratch.segments[span_segment(plan, c, k)].length = length
        for p in range(cable.first_pulley, cable.first_pulley + cable.pulleys):
            pulley = plan.pulleys[p]
            first, cells = pulley.first_contact, pulley.cells
            if cells == 1:
                continue
            between = max(scratch.arc[p] / cells, SHORTEST_SEGMENT)
            outer = middle_to_outer(scratch.arc[p], cells)
            scratch.segments[first + c].length -= outer
            scratch.segments[first + cells + c].length -= outer
            for q in range(first + 1, first + cells):
                scratch.segments[q + c].length = between


@stage
def follow_arc(
    plan: Plan,
    numbers: Numbers,
    c: int,
    k: int,
    before: StateViews,
    after: StateViews,
    scratch: ScratchViews,
) -> None:
    """Move the place of the middle of an arc along its path on the body: (E26).

    Args:
        plan, numbers: the prepared robot.
        c, k: cable, and number of the pulley in it.
        before: state before the sample.
        after: state after it; ``track`` is written.
        scratch: geometry of the sample.
    """
    cable = plan.cables[c]
    p = cable.first_pulley + k
    moved = 0.0
    if cable.routed == SPATIAL:
        node = cable.first_node + 1 + k
        radius = numbers.spatial_nodes[node].radius
        moved = motion_along(radius, before.middles[node], scratch.middles[node])
    else:
        moved = scratch.middle[p] - before.track[p]
        half_turn = pi * numbers.pulleys[p].radius
        if abs(moved) > half_turn > 0.0:  # whole turns are no motion
            moved = (moved + half_turn) % (2.0 * half_turn) - half_turn
    after.track[p] = before.track[p] + moved


@stage
def touches_anew(plan: Plan, c: int, k: int, before: StateViews, scratch: ScratchViews) -> bool:
    """Whether a cable touches the body of its pulley k, which it did not touch before."""
    cable = plan.cables[c]
    if cable.routed != SPATIAL:
        return False
    tangent = before.middles[cable.first_node + 1 + k].tangent
    missed = tangent[0] == 0.0 and tangent[1] == 0.0 and tangent[2] == 0.0
    return missed and scratch.wrap[cable.first_pulley + k] > 0.0


@stage
def place_contacts(
    plan: Plan,
    numbers: Numbers,
    c: int,
    before: StateViews,
    after: StateViews,
    scratch: ScratchViews,
) -> None:
    """Constants and places of the contacts of one cable, and the shift of (E25).

    Those of cells that are fixed to a surface are written by ``model.surface``.

    Args:
        plan, numbers: the prepared robot.
        c: the cable.
        before: state before the sample.
        after: state after it; ``place`` and ``track`` are written.
        scratch: geometry of the sample; the contacts are written.  Where the cable comes to touch a
            body in this sample, the wrap is set to 0: the contact holds no friction yet.
    """
    started = before.started[0] != 0.0
    for k in range(plan.cables[c].pulleys):
        p = plan.cables[c].first_pulley + k
        if plan.pulleys[p].surface >= 0:
            continue
        pulley = numbers.pulleys[p]
        first, cells = plan.pulleys[p].first_contact, plan.pulleys[p].cells
        follow_arc(plan, numbers, c, k, before, after, scratch)
        if started and touches_anew(plan, c, k, before, scratch):
            scratch.wrap[p] = 0.0
        share, between = 1.0, scratch.arc[p]
        if cells > 1:
            share, between = 1.0 / cells, scratch.arc[p] / cells
        for q in range(first, first + cells):
            contact = scratch.contacts[q]
            share_out(contact, pulley, share)
            after.place[q] = after.track[p] + (q - first - 0.5 * (cells - 1)) * between
            contact.shift = 0.0
            moved = after.place[q] - before.place[q]
            if started and moved != 0.0:
                contact.shift = moved / stretch_at(before, q, c)


@stage
def share_out(contact: Contact, pulley: PulleyNumbers, share: float) -> None:
    """Give a contact cell its share of the pulley's constants."""
    contact.share = share
    contact.stiffness = share * pulley.bristle_stiffness
    contact.damping = share * pulley.bristle_damping
    contact.viscous = share * pulley.viscous
    contact.drag = share * pulley.drag
    contact.breakaway = pulley.breakaway


@stage
def stretch_at(state: StateViews, q: int, c: int) -> float:
    """1 + mean strain of the two segments at contact q of cable c; slack ones have no strain."""
    before = max(state.length[q + c] / state.material[q + c], 1.0)
    return 0.5 * (before + max(state.length[q + c + 1] / state.material[q + c + 1], 1.0))
