"""Quasi-static balance of one elastic cable over bodies whose surface carries the friction.

A body's surface is divided into cells of equal length along the cable's track, which stay where
they are on the surface.  A cell that the cable covers holds the difference f between the tensions
behind and before it, a bristle of the elastic, perfectly plastic law:

    df = sigma dx,   |f| <= (1 - exp(-mu dbeta)) max(t before, t behind)

x is the unstretched cable that has moved past the cell, dbeta the angle that the cell wraps; sigma
is the cell's share of the arc times the stiffness of the whole contact.  Cells of which only a part
is covered count by that part.  They begin without friction and are forgotten when uncovered.  What
is covered in the course of a step sees half of the step's slip on average.

The unstretched cable is numbered from an end; a cell knows the number that is above its middle.
Between two neighbouring middles the strain is uniform.  As the arc's ends move, cable keeps its
number on the surface; what is laid onto it has the strain of the straight span that it comes from.
The cable on a drum does not slip and comes back with the strain with which it was wound.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

Array = NDArray[np.float64]

TOLERANCE = 1e-8
"""Largest imbalance of a cell [N], besides rounding."""

SLIVER = 1e-11
"""Covered length below which a cell does not count [m]."""


@dataclass(frozen=True)
class Contact:
    """A body in the way of a cable."""

    mu: float
    cell: float
    """Length of a cell along the cable [m]; 0: a point, which is one cell."""
    stiffness: float = 1e6
    """Of the bristles of the whole contact [N/m]."""


@dataclass(frozen=True)
class Cable:
    """What does not move."""

    stiffness: float
    """EA [N]."""
    preload: float
    """[N]."""
    contacts: tuple[Contact, ...]


@dataclass(frozen=True)
class Course:
    """A cable's path at one time, with B bodies."""

    span: Array
    """Straight lengths [m], shape (B + 1,); where a body is not touched, the whole line is in the
    span before it and the span behind it is 0."""
    first: Array
    """Places where the covered surface of the bodies begins [m], shape (B,)."""
    last: Array
    """Places where it ends [m]."""
    wrap: Array
    """Angles [rad]."""
    touching: NDArray[np.bool_]
    wound: Array
    """Cable on the drums at both ends since the start [m], shape (2,)."""


@dataclass(frozen=True)
class Cells:
    """Covered cells of one body."""

    index: NDArray[np.int64]
    begin: Array
    """Where their covered part begins [m]."""
    end: Array
    middle: Array
    friction: Array
    """Tension behind minus tension before [N]."""
    fresh: Array
    """Share of the covered part that has come in this step [-]."""
    number: Array
    """Unstretched cable from the start up to the middle [m]."""


@dataclass(frozen=True)
class State:
    """One cable at one time."""

    course: Course
    cells: tuple[Cells | None, ...]
    """None where the body is not touched."""
    ends: Array
    """Numbers of the first and the last point of the cable off the drums [m], shape (2,)."""
    drums: tuple[Array, Array]
    """What lies on the drums: cable wound [m] and the number at that place, shape (k, 2) each."""
    strain: Array
    """Between cells, shape (cells + 1,)."""
    spans: NDArray[np.int64]
    """Places of the straight spans in ``strain``, shape (B + 1,)."""

    def tension(self, cable):
        """Of the straight spans [N], shape (B + 1,)."""
        return cable.stiffness * np.maximum(self.strain[self.spans], 0.0)


def start(cable, course):
    """The cable under its preload, without friction."""
    strain = cable.preload / cable.stiffness
    cells, place = [], 0.0
    for b, contact in enumerate(cable.contacts):
        place += course.span[b]
        one = _cover(contact, course, b)
        if one is not None:
            number = (place + one.middle - course.first[b]) / (1.0 + strain)
            one = replace(one, number=number)
        place += course.last[b] - course.first[b]
        cells.append(one)
    end = (place + course.span[-1]) / (1.0 + strain)
    drums = [np.array([[w, m]]) for w, m in zip(course.wound, (0.0, end), strict=True)]
    chain = _Chain(cable, course, tuple(cells))
    strains = np.full(chain.middle.size + 1, strain)
    return State(
        course, tuple(cells), np.array([0.0, end]), (drums[0], drums[1]), strains, chain.spans,
    )  # fmt: skip


def _cover(contact, course, b):
    """Cells of body b that are covered, without friction; None where it is not touched."""
    first, last = course.first[b], course.last[b]
    if not course.touching[b]:
        return None
    if contact.cell == 0.0:
        index, begin, end = np.zeros(1, dtype=np.int64), np.zeros(1), np.zeros(1)
    else:
        index = np.arange(np.floor(first / contact.cell), np.ceil(last / contact.cell))
        index = index.astype(np.int64)
        begin = np.maximum(index * contact.cell, first)
        end = np.minimum((index + 1) * contact.cell, last)
        seen = end - begin > SLIVER
        if not seen.any():
            return None
        index, begin, end = index[seen], begin[seen], end[seen]
    zero = np.zeros(index.size)
    return Cells(index, begin, end, 0.5 * (begin + end), zero, zero, zero)


class _Chain:
    """All cells of a cable in a row: geometry of the elements between them."""

    def __init__(self, cable, course, cells):
        middle, loss, stiffness, place, count = [], [], [], 0.0, 0
        self.spans = np.zeros(course.span.size, dtype=np.int64)
        for b, (contact, one) in enumerate(zip(cable.contacts, cells, strict=True)):
            place += course.span[b]
            arc = course.last[b] - course.first[b]
            if one is not None:
                share = (one.end - one.begin) / arc if contact.cell else np.ones(1)
                middle.append(place + one.middle - course.first[b])
                loss.append(-np.expm1(-contact.mu * course.wrap[b] * share))
                stiffness.append(contact.stiffness * share * (1.0 - 0.5 * one.fresh))
                count += one.index.size
            place += arc
            self.spans[b + 1] = count
        empty = [np.empty(0)]
        self.middle = np.concatenate(middle or empty)
        """Places of the cells along the path [m]."""
        self.loss = np.concatenate(loss or empty)
        self.stiffness = np.concatenate(stiffness or empty)
        self.whole = place + course.span[-1]
        self.length = np.diff(self.middle, prepend=0.0, append=self.whole)
        """Of the elements [m]."""


def solve(cable, courses):
    """States at all courses, the first one under preload and without friction."""
    state = None
    for course in courses:
        state = start(cable, course) if state is None else advance(cable, state, course)
        yield state


def advance(cable, state, course):
    """The balance at the next course.

    Raises:
        ValueError: there is no balance.
    """
    cells = _carried(cable, state, course)
    chain = _Chain(cable, course, cells)
    ends, laid = _unwound(cable, state, course)
    number = np.concatenate([one.number for one in cells if one is not None] or [np.empty(0)])
    friction = np.concatenate([one.friction for one in cells if one is not None] or [np.empty(0)])
    material = np.diff(number, prepend=ends[0], append=ends[1])
    length = chain.length.copy()
    # Half of the cable laid onto a drum has the strain before the step, half that after it.
    length[0] += 0.5 * laid[0]
    length[-1] += 0.5 * laid[1]
    slip = _slips(cable.stiffness, length, material, friction, chain)
    strain = length / (material + np.diff(-slip, prepend=0.0, append=0.0)) - 1.0
    held = _friction(cable.stiffness * np.maximum(strain, 0.0), friction, slip, chain)[0]
    rows = np.cumsum([0 if one is None else one.index.size for one in cells])[:-1]
    parts = zip(np.split(held, rows), np.split(number - slip, rows), strict=True)
    settled = tuple(
        None if one is None else replace(one, friction=f, number=m)
        for one, (f, m) in zip(cells, parts, strict=True)
    )
    ends = ends + np.array([0.5, -0.5]) * laid / (1.0 + strain[[0, -1]])
    drums = _wound(state.drums, course.wound, ends)
    return State(course, settled, ends, drums, strain, chain.spans)


def _carried(cable, state, course):
    """Cells at the next course with their history, before anything slips."""
    cells = []
    laid = state.strain[state.spans]
    for b, contact in enumerate(cable.contacts):
        new, old = _cover(contact, course, b), state.cells[b]
        if new is not None and old is not None:
            number = _numbers(state, b, new.middle, laid[b : b + 2])
            new = replace(new, number=number)
            common, mine, his = np.intersect1d(
                new.index, old.index, assume_unique=True, return_indices=True
            )
            friction, fresh = np.zeros(new.index.size), np.ones(new.index.size)
            if contact.cell == 0.0:
                friction[mine], fresh[mine] = old.friction[his], 0.0
            elif common.size:
                both = np.minimum(new.end[mine], old.end[his]) - np.maximum(
                    new.begin[mine], old.begin[his]
                )
                both = np.maximum(both, 0.0)
                friction[mine] = both / (old.end[his] - old.begin[his]) * old.friction[his]
                fresh[mine] = 1.0 - both / (new.end[mine] - new.begin[mine])
            new = replace(new, friction=friction, fresh=fresh)
        cells.append(new)
    return _touched(cable, state, course, cells)


def _numbers(state, b, place, laid):
    """Numbers of the cable above places of body b; what is laid has the strains ``laid``."""
    old, was = state.cells[b], state.course
    strain = state.strain[[state.spans[b], state.spans[b + 1]]]
    first, last = was.first[b], was.last[b]
    begin = old.number[0] - (old.middle[0] - first) / (1.0 + strain[0])
    end = old.number[-1] + (last - old.middle[-1]) / (1.0 + strain[1])
    knots = np.concatenate([[first], old.middle, [last]])
    number = np.interp(place, knots, np.concatenate([[begin], old.number, [end]]))
    number += np.minimum(place - first, 0.0) / (1.0 + laid[0])
    return number + np.maximum(place - last, 0.0) / (1.0 + laid[1])


def _touched(cable, state, course, cells):
    """Number the cells of bodies that are touched for the first time, at the strain around them."""
    new = [
        one is not None and before is None for one, before in zip(cells, state.cells, strict=True)
    ]
    if not any(new):
        return cells
    middle = _Chain(cable, course, cells).middle
    counts = [0 if one is None else one.index.size for one in cells]
    known = np.repeat(np.logical_not(new), counts)
    number = np.concatenate([one.number for one in cells if one is not None])
    whole = _Chain(cable, course, cells).whole
    number = np.interp(
        middle,
        np.concatenate([[0.0], middle[known], [whole]]),
        np.concatenate([state.ends[:1], number[known], state.ends[1:]]),
    )
    fresh = np.concatenate([one.fresh for one in cells if one is not None])
    rows = np.cumsum(counts)[:-1]
    parts = zip(np.split(number, rows), np.split(np.where(known, fresh, 1.0), rows), strict=True)
    return [
        None if one is None else replace(one, number=part, fresh=share)
        for one, (part, share) in zip(cells, parts, strict=True)
    ]


def _unwound(cable, state, course):
    """Numbers of the ends after unwinding and half of the winding; the lengths wound on."""
    ends, laid = state.ends.copy(), np.maximum(course.wound - state.course.wound, 0.0)
    for end, sign in enumerate((1.0, -1.0)):
        wound, stack = course.wound[end], state.drums[end]
        if laid[end] == 0.0:
            ends[end] = np.interp(wound, stack[:, 0], stack[:, 1])
            deeper = min(wound - stack[0, 0], 0.0)
            ends[end] += sign * deeper / (1.0 + cable.preload / cable.stiffness)
        ends[end] += 0.5 * sign * laid[end] / (1.0 + state.strain[-end])
    return ends, laid


def _wound(drums, wound, ends):
    """What lies on the drums afterwards."""
    stacks = []
    for end, stack in enumerate(drums):
        if wound[end] == stack[-1, 0]:
            stacks.append(stack)
            continue
        below = stack[stack[:, 0] < wound[end]]
        stacks.append(np.append(below, [[wound[end], ends[end]]], axis=0))
    return stacks[0], stacks[1]


def _friction(tension, friction, slip, chain):
    """Friction, the sign of its bound where that is reached, and where the pull is behind."""
    before, behind = tension[:-1], tension[1:]
    bound = chain.loss * np.maximum(before, behind)
    trial = friction + chain.stiffness * slip
    reached = (trial > bound).astype(float) - (trial < -bound)
    return np.clip(trial, -bound, bound), reached, behind >= before


def _slips(EA, length, material, friction, chain):
    """Slips of all cells in balance, by Newton's method with a line search.

    Raises:
        ValueError: it does not converge.
    """
    slip = np.zeros(friction.size)
    if slip.size == 0:
        return slip

    def residual(slip):
        held = material + np.diff(-slip, prepend=0.0, append=0.0)
        if not np.all(held > 0.0):
            return held, held, held, held, np.inf
        tension = EA * np.maximum(length / held - 1.0, 0.0)
        force, reached, behind = _friction(tension, friction, slip, chain)
        rest = np.diff(tension) - force
        slope = np.where(tension > 0.0, EA * length / held**2, 1e-6 * EA / length)
        return rest, slope, reached, behind.astype(float), float(np.abs(rest).max())

    rest, slope, reached, behind, worst = residual(slip)
    limit = TOLERANCE + 1e-13 * EA
    for _ in range(200):
        if worst < limit:
            return slip
        on_behind = 1.0 - reached * chain.loss * behind
        on_before = 1.0 + reached * chain.loss * (1.0 - behind)
        bands = np.zeros((3, slip.size))
        bands[1] = -on_behind * slope[1:] - on_before * slope[:-1]
        bands[1] -= np.where(reached == 0.0, chain.stiffness, 0.0)
        bands[0, 1:] = (on_behind * slope[1:])[:-1]
        bands[2, :-1] = (on_before * slope[:-1])[1:]
        step = -solve_banded((1, 1), bands, rest)
        share = 1.0
        while True:
            tried = residual(slip + share * step)
            if tried[-1] < worst * (1.0 - 0.01 * share) or share < 1e-3:
                break
            share *= 0.5
        slip = slip + share * step
        rest, slope, reached, behind, worst = tried
    raise ValueError(f"the cable has no balance: a cell lacks {worst:.1e} N")
