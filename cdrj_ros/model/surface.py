"""Contact cells that are fixed to the surface of a body, of which the simulated rig has some.

The path of a cable on its body is measured by the place of a point on it [m], towards the last
node: (E26).  Cell j takes the places from j w to (j + 1) w.  An arc covers those between its ends;
where an end moves, cable is laid onto new cells, or leaves cells with what they remember.

A pulley has a row of cells at hand, the first of which holds the arc's beginning.  When another
one does, the row moves on.  Cells at its end that are not covered have no friction; their contacts
lie in the free span behind the arc.  See docs/model.md, section 8.
"""

from __future__ import annotations

from math import floor
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.cells import (
    SHORTEST_SEGMENT,
    follow_arc,
    middle_to_outer,
    share_out,
    stretch_at,
    touches_anew,
)
from cdrj_ros.model.compiled import callee, lean, stage
from cdrj_ros.model.linked import linked_lazily
from cdrj_ros.model.packing import Indices, Numbers, Plan, number_views, plan_views
from cdrj_ros.model.state import ScratchViews, StateViews, scratch_views, state_views
from cdrj_ros.model.views import copy_part

Vector = NDArray[np.float64]


@lean
def cover_surfaces(
    plan: Indices, numbers: Vector, before: Vector, out: Vector, scratch: Vector
) -> bool:
    """Lay the arcs of a sample onto the cells of their surfaces: (E29).

    Args:
        plan, numbers: the prepared robot.
        before: begins with the state before the sample; not changed.
        out: begins with the state after it; ``track``, ``place`` and ``covered`` of the cells are
            written.
        scratch: with the geometry of the sample.  The contacts of the cells, the lengths of the
            segments and ``history`` are written.  Where the cable comes to touch a body in this
            sample, the wrap is set to 0.

    Returns:
        Whether other cells are at hand than in the sample before.
    """
    parts = plan_views(plan)
    sizes = parts.sizes
    constants = number_views(sizes, numbers)
    state, after = state_views(sizes, before), state_views(sizes, out)
    found = scratch_views(sizes, scratch)
    history = state_views(sizes, found.history)
    copy_part(before, 0, found.history)
    started, others = state.started[0] != 0.0, False
    for c in range(len(parts.cables)):
        cable = parts.cables[c]
        for k in range(cable.pulleys):
            p = cable.first_pulley + k
            surface = parts.pulleys[p].surface
            if surface < 0:
                continue
            follow_arc(parts, constants, c, k, state, after, found)
            if started and touches_anew(parts, c, k, state, found):
                found.wrap[p] = 0.0
            after.covered[surface] = found.arc[p]
            if started:
                others |= _move_row(parts, constants, c, p, history, after)
            _place_row(parts, constants, c, p, history, after, found)
    return others


cover_surfaces_linked: Final = linked_lazily(
    cover_surfaces,
    "boolean(Array(int64, 1, 'C', True), Array(float64, 1, 'C', True),"
    " float64[::1], float64[::1], float64[::1])",
)
"""``cover_surfaces``, to be called by kernels."""


@stage
def _ends(state: StateViews, p: int, surface: int) -> tuple[float, float]:
    """Places of both ends of an arc [m]."""
    half = 0.5 * state.covered[surface]
    return state.track[p] - half, state.track[p] + half


@stage
def _part(cell: int, last: int, width: float, begin: float, end: float) -> tuple[float, float]:
    """Places between which an arc covers a cell; the last one at hand takes the rest of the arc."""
    return max(begin, cell * width), end if cell == last else min(end, (cell + 1) * width)


@stage
def _move_row(
    plan: Plan, numbers: Numbers, c: int, p: int, history: StateViews, after: StateViews
) -> bool:
    """Let the row of a pulley begin with the cell that now holds the arc's beginning.

    Args:
        plan, numbers: the prepared robot.
        c, p: cable and pulley.
        history: the state before by the cells at hand before, afterwards by those now.
        after: ``track`` and ``covered`` of the pulley are given.

    Returns:
        Whether the row has moved.
    """
    own, width = plan.pulleys[p], numbers.pulleys[p].cell_width
    cells, contact = own.cells, own.first_contact
    old_begin, old_end = _ends(history, p, own.surface)
    begin, end = _ends(after, p, own.surface)
    old_first, first = floor(old_begin / width), floor(begin / width)
    if first != old_first:
        forward = first > old_first
        way: Any = np.int64(1 if forward else -1)  # a literal has its own type
        outer = 0 if forward else cells - 1  # the first cell that leaves
        segment = contact + c + (0 if forward else cells)
        count = min(abs(first - old_first), cells)
        edge = old_end if forward else old_begin
        _exchange(history, contact + outer, segment, way, cells, count, width, edge)
    # a cell keeps the bristles of that part of it that stays covered
    old_last, last = old_first + cells - 1, first + cells - 1
    for i in range(cells):
        lower, upper = _part(first + i, old_last, width, old_begin, old_end)
        whole = upper - lower
        now_lower, now_upper = _part(first + i, last, width, begin, end)
        stays = min(upper, now_upper) - max(lower, now_lower)
        share = min(stays / whole, 1.0) if whole > 0.0 and stays > 0.0 else 0.0
        history.bristle[contact + i] *= share
    return first != old_first


@callee
def _exchange(
    state: StateViews,
    contact: int,
    segment: int,
    way: int,
    cells: int,
    count: int,
    width: float,
    edge: float,
) -> None:
    """Let cells leave at one end of a row, and as many without history enter at the other.

    Args:
        state: changed.
        contact, segment: the outermost ones where cells leave.
        way: +1 where this is the beginning of the row, otherwise -1.
        cells: number of the row's cells.
        count: how many of them leave.
        width: of a cell [m].
        edge: place of the arc's other end, for new cells if all leave [m].
    """
    rest = cells - count
    _leave(state, contact, segment, way, rest, count)
    place, slip_speed, lagged_speed = edge, 0.0, 0.0
    if rest > 0:  # the cable slides on new cells as on their neighbour
        q = contact + way * (rest - 1)
        place = state.place[q]
        slip_speed, lagged_speed = state.slip_speed[q], state.lagged_speed[q]
    piece = _divide(state, segment + way * rest, way, count, width)
    for i in range(rest, cells):
        q = contact + way * i
        place += way * piece
        state.place[q], state.bristle[q] = place, 0.0
        state.slip_speed[q], state.lagged_speed[q] = slip_speed, lagged_speed


@stage
def _leave(state: StateViews, contact: int, segment: int, way: int, rest: int, count: int) -> None:
    """Join the segments between the cells that leave; ``rest`` cells stay and move up."""
    length, material, delayed = 0.0, 0.0, 0.0
    for i in range(count + 1):
        e = segment + way * i
        length += state.length[e]
        material += state.material[e]
        delayed += state.material[e] * state.delayed[e]
    state.length[segment], state.material[segment] = length, material
    state.delayed[segment] = delayed / material
    for i in range(1, rest + 1):
        e, source = segment + way * i, segment + way * (i + count)
        state.length[e], state.material[e] = state.length[source], state.material[source]
        state.delayed[e] = state.delayed[source]
    for i in range(rest):
        q, source = contact + way * i, contact + way * (i + count)
        state.place[q], state.bristle[q] = state.place[source], state.bristle[source]
        state.slip_speed[q] = state.slip_speed[source]
        state.lagged_speed[q] = state.lagged_speed[source]


@stage
def _divide(state: StateViews, segment: int, way: int, count: int, width: float) -> float:
    """Divide a segment into ``count`` pieces and the rest; returns the length of a piece [m].

    No material is lost, and each piece has the strain of the whole.
    """
    length, material = state.length[segment], state.material[segment]
    delayed = state.delayed[segment]
    piece = min(width, 0.5 * length / (count + 1))
    content = material * (piece / length)
    for i in range(count):
        e = segment + way * i
        state.length[e], state.material[e], state.delayed[e] = piece, content, delayed
    beyond = segment + way * count
    state.length[beyond] = length - count * piece
    state.material[beyond], state.delayed[beyond] = material - count * content, delayed
    return piece


@stage
def _room(plan: Plan, c: int, p: int, scratch: ScratchViews) -> float:
    """Length of the free span after a pulley [m]."""
    cable, e = plan.cables[c], plan.pulleys[p].element + 1
    room = scratch.element_length[e] - 0.5 * scratch.arc[p]
    if p + 1 < cable.first_pulley + cable.pulleys:
        room -= 0.5 * scratch.arc[p + 1]
    return max(room, 0.0)


@stage
def _place_row(
    plan: Plan,
    numbers: Numbers,
    c: int,
    p: int,
    history: StateViews,
    after: StateViews,
    scratch: ScratchViews,
) -> None:
    """Constants, places and shifts (E25) of a pulley's cells, and the lengths of the segments.

    The contact of a cell lies in the middle of its covered part.
    """
    own, pulley = plan.pulleys[p], numbers.pulleys[p]
    cells, width, arc, track = own.cells, pulley.cell_width, scratch.arc[p], after.track[p]
    begin, end = _ends(after, p, own.surface)
    first = floor(begin / width)
    spacing = min(width, 0.5 * _room(plan, c, p, scratch) / cells)
    started = history.started[0] != 0.0
    beyond, place_before = end, 0.0
    for i in range(cells):
        q = own.first_contact + i
        lower, upper = _part(first + i, first + cells - 1, width, begin, end)
        contact = scratch.contacts[q]
        if upper > lower:
            share_out(contact, pulley, (upper - lower) / arc)
            place = 0.5 * (lower + upper)
        else:
            share_out(contact, pulley, 0.0)
            beyond += spacing
            place = beyond
        if i > 0:
            place = max(place, place_before + SHORTEST_SEGMENT)
            scratch.segments[q + c].length = place - place_before
        after.place[q], place_before = place, place
        contact.shift = 0.0
        if started and place != history.place[q]:
            contact.shift = (place - history.place[q]) / stretch_at(history, q, c)
    # an element ends in the middle of the arc
    outer = middle_to_outer(arc, cells)
    scratch.segments[own.first_contact + c].length += after.place[own.first_contact] - track + outer
    scratch.segments[own.first_contact + cells + c].length -= place_before - track - outer
