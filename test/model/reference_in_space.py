"""Lengths, wraps and lever arms of cables by positions, by section 13 of docs/model.md.

A robot in the plane is one in space whose axes are z.  The contact with a node follows from the
points of its neighbours, which are given: where all contacts are those that were given, the sweeps
of 13.3 would change nothing any more.

Every vector with an index of a body is in that body's own axes: z is its axis.  The derivatives of
the frames are complex steps.  Drums have no pitch (G10).  Speed does not matter.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from model.reference_geometry import STEP, Geometry, Vector, by_tables, tabled
from scipy.optimize import brentq

from cdrj_ros.robot.description import Winch

Z = np.array([0.0, 0.0, 1.0])
LEAST_SHARE = 1e-3
"""Least distance along a line of the nodes that it misses, as a share of the line, (G9)."""


@dataclass(frozen=True)
class Contact:
    """A cable on a node, in the base unless it says otherwise."""

    entry: Vector
    exit: Vector
    touches: bool = True
    wrap: float = 0.0
    arc: float = 0.0
    normal: tuple[Vector, Vector] = (Z, Z)
    """At entry and exit, in the body's axes."""
    middle: Vector = field(default_factory=lambda: Z)
    """Its normal n of (G13), in the body's axes."""
    tangent: Vector = field(default_factory=lambda: Z)
    """Its direction t, in the body's axes."""
    height: float = 0.0
    """Its z [m]."""


# --- frames, 13.1 --------------------------------------------------------------------------------


def turned(axis, angle):
    """Rotation about an axis (Rodrigues)."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k)


def frames(robot, q):
    """Every frame in the base, parents first."""
    joints = [joint.name for joint in robot.joints]
    found = {}
    for frame in robot.frames:
        rotation, origin = np.reshape(frame.rotation, (3, 3)) + 0j, np.array(frame.origin) + 0j
        if frame.joint is not None:
            by = frame.multiplier * q[joints.index(frame.joint)] + frame.offset
            axis = np.array(frame.axis)
            if frame.motion == "prismatic":
                origin = origin + rotation @ axis * by
            elif frame.motion in ("revolute", "continuous"):
                rotation = rotation @ turned(axis, by)
            elif frame.motion == "rolling":
                radius = turned(axis, by) @ np.array([frame.rolling_radius, 0.0, 0.0])
                origin = origin + rotation @ (2.0 * radius)
                rotation = rotation @ turned(axis, 2.0 * by)
        if frame.parent is not None:
            above, at = found[frame.parent]
            rotation, origin = above @ rotation, at + above @ origin
        found[frame.name] = rotation, origin
    return found


def own_axes(place):
    """Unit vectors of a body's own axes in its frame, by columns; the last is its axis."""
    z = np.array(place.axis)
    x = np.eye(3)[0 if abs(z[0]) < 0.9 else 1]
    x = x - z * (x @ z)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


# --- shapes of nodes, 13.2 -----------------------------------------------------------------------


def tangent(a, axis, r, sense):
    """(G2), (G4): normal where a line from a meets a circle, and its length."""
    line = np.sqrt(a @ a - r * r)
    return (r * a + sense * line * np.cross(axis, a)) / (a @ a), float(line)


def angle(one, other, axis, sense):
    """From one vector to the other about an axis, in [0, 2 pi)."""
    found = sense * np.arctan2(axis @ np.cross(one, other), one @ other)
    return float(found % (2.0 * np.pi))


def nearest(a, b):
    """Point of the line through a and b that is nearest to the centre, and its share of a to b."""
    share = -((b - a) @ a) / ((b - a) @ (b - a))
    return a + share * (b - a), float(share)


def way_round(node, a, b, axis, side):
    """Whether the cable touches a round body, and its sense about the axis."""
    place = node.place
    at = min(max(nearest(a, b)[1], 0.0), 1.0)
    close = a + at * (b - a)
    through = bool(np.linalg.norm(close) <= node.radius)
    left = axis @ np.cross(a, b)
    if place.turn:
        return through or place.turn * left < 0.0 or place.turns > 0, float(place.turn)
    shorter = 1.0 if left >= 0.0 else -1.0
    if place.sided:  # (G15): whether -side = x a + y b with positive x and y
        x, y = np.linalg.lstsq(np.stack([a, b], axis=1), -side, rcond=None)[0]
        if x > 0.0 and y > 0.0:
            return True, -shorter
    return through, shorter


def arc(node, a, b, axis, sense):
    """Normals of an arc in a plane through the centre, its angle and both free lengths."""
    first, before = tangent(a, axis, node.radius, sense)
    last, after = tangent(b, axis, node.radius, -sense)
    turns = node.place.turns if node.place else 0
    return first, last, angle(first, last, axis, sense) + 2 * np.pi * turns, before, after


def grooved(node, a, b, near):
    """A grooved pulley; ``near``: its wrap in the reference pose [rad]."""
    flat, sense = np.array([1.0, 1.0, 0.0]), float(node.place.turn)
    first, last, found, _, _ = arc(node, a * flat, b * flat, Z, sense)
    found = near + (found - near + np.pi) % (2 * np.pi) - np.pi
    n = turned(Z, sense * 0.5 * found).real @ first
    return Contact(node.radius * first, node.radius * last, True, found, node.radius * found,
                   (first, last), n, sense * np.cross(Z, n))  # fmt: skip


def cylinder(node, a, b, side):
    """(G5), or (G6) where the cable runs through a ring."""
    flat = np.array([1.0, 1.0, 0.0])
    if node.place.inside:
        return through_ring(node, a, b, Z, a * flat, b * flat)
    touches, sense = way_round(node, a * flat, b * flat, Z, side * flat)
    first, last, by, before, after = arc(node, a * flat, b * flat, Z, sense)
    whole, rise = before + node.radius * by + after, b[2] - a[2]
    slope = rise / whole
    low, high = a[2] + slope * before, b[2] - slope * after
    n, stretch = turned(Z, sense * 0.5 * by).real @ first, np.hypot(1.0, slope)
    return Contact(
        node.radius * first + low * Z, node.radius * last + high * Z, touches, by / stretch,
        node.radius * by * stretch, (first, last), n,
        (sense * np.cross(Z, n) + slope * Z) / stretch, 0.5 * (low + high),
    )  # fmt: skip


def sphere(node, a, b, side):
    """A great circle."""
    axis = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    if node.place.inside:
        return through_ring(node, a, b, axis, a, b)
    touches, sense = way_round(node, a, b, axis, side - axis * (side @ axis))
    first, last, by, _, _ = arc(node, a, b, axis, sense)
    n = turned(axis, sense * 0.5 * by).real @ first
    return Contact(node.radius * first, node.radius * last, touches, by, node.radius * by,
                   (first, last), n, sense * np.cross(axis, n))  # fmt: skip


def through_ring(node, a, b, axis, flat_a, flat_b):
    """(G6): where the cable bends over the near side of a ring."""
    close, share = nearest(flat_a, flat_b)
    free = 0.0 < share < 1.0 and bool(np.linalg.norm(close) <= node.radius)

    def out(by):
        return np.asarray(turned(axis, by).real @ close / np.linalg.norm(close))

    def units(by):
        ways = [one - node.radius * out(by) for one in (flat_a, flat_b)]
        return np.sum([way / np.linalg.norm(way) for way in ways], axis=0)

    n = out(brentq(lambda by: np.cross(axis, out(by)) @ units(by), -1.5, 1.5, xtol=1e-15))
    lengths = [np.linalg.norm(one - node.radius * n) for one in (flat_a, flat_b)]
    height = float((a + (b - a) * lengths[0] / sum(lengths)) @ Z) if axis is Z else 0.0
    point = node.radius * n + height * Z
    came, goes = point - a, b - point
    along = 0.5 * (came / np.linalg.norm(came) + goes / np.linalg.norm(goes))
    return Contact(point, point, not free, 0.0, 0.0, (n, n), n, along, height)


def swivel(node, b):
    """(G7): the cable enters along z at the origin."""
    out = np.array([b[0], b[1], 0.0]) / np.hypot(b[0], b[1])
    x, y, r = np.hypot(b[0], b[1]) - node.radius, b[2], node.radius
    line = np.sqrt(x * x + y * y - r * r)
    wrap = float(np.arctan2(line * x + r * y, line * y - r * x) % (2.0 * np.pi))
    end = r * (1.0 - np.cos(wrap)) * out + r * np.sin(wrap) * Z
    c, s = np.cos(0.5 * wrap), np.sin(0.5 * wrap)
    in_plane = np.array([[-c, s, 0.0], [s, c, 0.0]])
    return Contact(np.zeros(3), end, True, wrap, r * wrap, (Z, Z), in_plane[0], in_plane[1])


# --- the whole cable, 13.3 -----------------------------------------------------------------------


@dataclass(frozen=True)
class Path:
    """A cable in one pose."""

    contacts: tuple[Contact, ...]
    ends: tuple[tuple[float, float], ...]
    """Of either end: angle of its point of contact about its axis, and turn of its frame [rad]."""


Paths = tuple[Path | None, ...]
"""Of all cables in one pose; None for those by tables."""


def paths(robot, q, touches, rest):
    """Paths in a pose; ``touches``: those of the estimator, ``rest``: in the reference pose."""
    found = []
    first = 0
    for c, cable in enumerate(robot.cables):
        own = touches[first : first + len(cable.nodes)]
        first += len(cable.nodes)
        found.append(
            path(robot, cable, q, own, rest[c] if rest else None) if cable.placed else None
        )
    return tuple(found)


def path(robot, cable, q, touches, rest):
    """Points of contact, each from those of the neighbours, which are the estimator's.

    ``rest`` is the path in the reference pose, None for that pose itself.
    """
    poses, last = frames(robot, q + 0j), len(cable.nodes) - 1
    spots = [node.place for node in cable.nodes if node.place]
    bases = [poses[p.frame][0].real @ own_axes(p) for p in spots]
    turns = [
        frame_turn(robot, spots[k].frame, q, bases[k][:, 2]) if spots[k].kind == "pulley" else 0.0
        for k in (0, last)
    ]
    contacts, angles = [], [0.0, 0.0]
    for k, (node, p) in enumerate(zip(cable.nodes, spots, strict=True)):
        centre = point(poses, p.frame, p.position).real
        far = point(poses, p.exit_frame, p.exit).real
        if p.kind in ("point", "sheath"):
            contacts.append(Contact(centre, far if p.kind == "sheath" else centre))
            continue
        before = [one["exit"] for one in touches[:k] if one["touching"]]
        after = [one["entry"] for one in touches[k + 1 :] if one["touching"]]
        ways = ((before or after[:1])[-1], (after or before[-1:])[0])
        a, b = (bases[k].T @ (one - centre) for one in ways)
        if p.kind == "pulley":
            new = grooved(node, a, b, rest.contacts[k].wrap if rest else np.pi)
        elif p.kind == "swivel":
            new = swivel(node, b)
        elif min(np.linalg.norm(a), np.linalg.norm(b)) <= node.radius:
            new = Contact(Z, Z, touches=False)  # ignored_inside
        else:
            side = bases[k].T @ (far - centre)
            new = (cylinder if p.kind == "cylinder" else sphere)(node, a, b, side)
        if k in (0, last):
            x, y, _ = new.normal[0 if k else 1]
            angles[k == last] = float(np.arctan2(y, x))
        entry, leaves = (centre + bases[k] @ one for one in (new.entry, new.exit))
        if not new.touches:
            entry = leaves = centre
        contacts.append(replace(new, entry=entry, exit=leaves))
    return Path(tuple(contacts), tuple(zip(angles, turns, strict=True)))


def wound(node, now, rest, end):
    """(G8): angle of cable that has come onto an end since the reference pose [rad]."""
    (angle_now, turn), (angle_then, turn_then) = now, rest.ends[end]
    grown = angle_now - angle_then + turn - turn_then
    grown = (grown + np.pi) % (2 * np.pi) - np.pi - (turn - turn_then)
    return float(node.place.turn * grown * (-1.0 if end else 1.0))


def frame_turn(robot, frame, q, axis):
    """Turn of a frame about an axis by all joints [rad]."""
    turn = 0.0
    for j in range(q.size):
        rotation = frames(robot, stepped(q, j))[frame][0]
        spin = rotation.imag / STEP @ rotation.real.T
        turn += float(axis @ [spin[2, 1], spin[0, 2], spin[1, 0]] * q[j])
    return turn


def stepped(q, j):
    """Joint angles with an imaginary step of one."""
    moved = q + 0j
    moved[j] += 1j * STEP
    return moved


def point(poses, frame, local):
    """A point of a frame in the base [m]."""
    rotation, origin = poses[frame]
    return np.asarray(origin + rotation @ np.asarray(local))


def bend(before, after):
    """Angle between two directions [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(before, after)), before @ after))


def elements(cable, found):
    """Straight lengths [m] and directions of the elements; (G9) where a body is passed by."""
    contacts, last = found.contacts, len(cable.nodes) - 1
    length, direction = np.zeros(last), np.zeros((last, 3))
    touching = [k for k, one in enumerate(contacts) if one.touches]
    for p, k in pairwise(touching):
        start, way = contacts[p].exit, contacts[k].entry - contacts[p].exit
        shares = [0.0]
        for m in range(p + 1, k):
            share = (contacts[m].entry - start) @ way / (way @ way)
            room = LEAST_SHARE * (m - p), 1.0 - LEAST_SHARE * (k - m)
            low = max(shares[-1] + LEAST_SHARE * (m > p + 1), room[0])
            shares.append(float(np.clip(share, low, room[1])))
        length[p:k] = np.diff([*shares, 1.0]) * np.linalg.norm(way)
        direction[p:k] = way / np.linalg.norm(way)
    return length, direction


def arms(robot, cable, found, q, direction):
    """(G12): lever arms of the elements about the joints [m]; points rest in their bodies."""
    spots = [node.place for node in cable.nodes if node.place]
    poses, arm = frames(robot, q + 0j), np.zeros((len(spots) - 1, q.size))
    for j in range(q.size):
        moved = frames(robot, stepped(q, j))

        def velocity(frame, at, moved=moved):
            rotation, origin = poses[frame]
            local = rotation.real.T @ (at - origin.real)
            return np.asarray(point(moved, frame, local).imag / STEP)

        for e, (one, other) in enumerate(pairwise(spots)):
            leaves = velocity(one.exit_frame if one.kind == "sheath" else one.frame,
                              found.contacts[e].exit)  # fmt: skip
            arrives = velocity(other.frame, found.contacts[e + 1].entry)
            arm[e, j] = direction[e] @ (arrives - leaves)
    return arm


def geometry(robot, q, now, rest):
    """All cables of a robot; ``middle`` of cables by positions is left at 0, see ``moved``."""
    parts = [
        by_positions(robot, cable, q, found, then) if found and then else by_tables(robot, cable, q)
        for cable, found, then in zip(robot.cables, now, rest, strict=True)
    ]
    return Geometry(
        *(np.concatenate(part) for part in zip(*(vars(one).values() for one in parts), strict=True))
    )


def by_positions(robot, cable, q, found, rest):
    """Section 13 for one cable."""
    length, direction = elements(cable, found)
    wrap, arcs = np.zeros((2, len(cable.pulleys)))
    for k, (node, one) in enumerate(zip(cable.pulleys, found.contacts[1:-1], strict=True)):
        if not one.touches:
            continue
        wrap[k], arcs[k] = one.wrap, one.arc
        if node.place.kind == "sheath":
            wrap[k], arcs[k] = bend_of(robot, node, q), node.place.length
        elif node.place.kind == "point" or node.place.inside:
            wrap[k] = bend(direction[k], direction[k + 1])
    length[:-1] += 0.5 * arcs
    length[1:] += 0.5 * arcs
    laid, levers = np.zeros((2, 2))
    for end, node in enumerate((cable.nodes[0], cable.nodes[-1])):
        radius = node.effective_radius if isinstance(node, Winch) else node.radius
        levers[end] = radius
        if node.place.kind == "pulley":
            laid[end] = radius * wound(node, found.ends[end], rest, end)
            axis = frames(robot, q + 0j)[node.place.frame][0].real @ own_axes(node.place)[:, 2]
            levers[end] = node.radius * np.linalg.norm(np.cross(axis, direction[-end]))
    length[0] += laid[0]
    length[-1] += laid[1]
    arm = arms(robot, cable, found, q, direction)
    return Geometry(length, arm, wrap, direction, arcs, 0.0 * arcs, levers, laid)


def bend_of(robot, node, q):
    """Wrap of a sheath: a sum of constants and tables."""
    joints = [joint.name for joint in robot.joints]
    return float(sum(
        tabled(profile, q[joints.index(profile.joint)] if profile.joint else 0.0).real
        for profile in node.wrap
    ))  # fmt: skip


# --- motion of the middle of an arc, 13.4 ---------------------------------------------------------


def moved(robot, before, now):
    """(G13), (E26): motion of the middles of all arcs on their bodies between two poses [m]."""
    found = []
    for cable, one, other in zip(robot.cables, before[1], now[1], strict=True):
        if one is None or other is None:
            places = [by_tables(robot, cable, q).middle for q, _ in (before, now)]
            found.extend((places[1] - places[0]).tolist())
            continue
        both = one.contacts[1:-1], other.contacts[1:-1]
        for node, c, d in zip(cable.pulleys, *both, strict=True):
            if not (c.touches and d.touches) or not node.radius:
                found.append(0.0)
                continue
            along = (c.tangent + d.tangent) / np.linalg.norm(c.tangent + d.tangent)
            along = along * 0.5 * (np.linalg.norm(c.tangent) + np.linalg.norm(d.tangent))
            way = d.middle - c.middle
            chord = np.linalg.norm(way)
            if chord > 0.0:
                way = way * (2.0 * np.arcsin(min(0.5 * chord, 1.0)) / chord)
            found.append(float(node.radius * way @ along + (d.height - c.height) * along[2]))
    return np.array(found)
