"""The path of one cable over its nodes: all points of contact of all poses, solved together.

The equations of all bodies of a cable form one system in the unknowns of all of them, which
Newton's method solves with differences for derivatives.  Along the motion, the surface under the
cable is followed by the motion of the path along its own direction: a point of a body, over which
the path moves sideways, keeps its place along the path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truth.bodies import ENDS, Node, contacts, equations, guess
from truth.frames import Pose

Array = NDArray[np.float64]

STRIDE = 20
"""Poses from one to the next that is solved by itself; guesses in between are interpolated."""

STEP = 1e-6
"""Of the differences [rad] or [m]."""


@dataclass(frozen=True)
class Path:
    """A cable at n poses; it has S straight spans and B = S - 1 bodies between its ends."""

    span: Array
    """Straight lengths [m], shape (n, S)."""
    direction: Array
    """From the first node to the last, shape (n, S, 3)."""
    begin: Array
    """Point where a span leaves the body before it [m], shape (n, S, 3)."""
    end: Array
    """Point where it meets the body behind it [m], shape (n, S, 3)."""
    first: Array
    """Place of the first point of contact on every body's surface, along the path [m], (n, B)."""
    last: Array
    """The same of the last point of contact."""
    wrap: Array
    """Angle through which the cable turns on every body [rad], shape (n, B)."""
    touching: NDArray[np.bool_]
    """Shape (n, B)."""
    wound: Array
    """Cable laid onto both ends as tangents move, their motors at rest [m], shape (n, 2)."""

    @property
    def length(self) -> Array:
        """Of the whole cable, with what tangents have laid onto its ends [m], shape (n,)."""
        return self.span.sum(1) + (self.last - self.first).sum(1) + self.wound.sum(1)


@dataclass(frozen=True)
class _Chain:
    """The nodes that a cable touches, at n poses."""

    nodes: tuple[Node, ...]
    centre: tuple[Array, ...]
    basis: tuple[Array, ...]
    """From a node's axes to the base, each of shape (n, 3, 3)."""
    exits: tuple[Array | None, ...]
    """Far end of a sheath."""

    @property
    def size(self) -> int:
        return sum(node.unknowns for node in self.nodes)

    def part(self, rows: slice | NDArray[np.intp]) -> _Chain:
        exits = tuple(None if e is None else e[rows] for e in self.exits)
        centre = tuple(c[rows] for c in self.centre)
        return _Chain(self.nodes, centre, tuple(b[rows] for b in self.basis), exits)

    def shares(self, x: Array) -> list[Array]:
        """Every node's unknowns."""
        return np.split(x, np.cumsum([node.unknowns for node in self.nodes])[:-1], axis=1)

    def local(self, k: int, point: Array) -> Array:
        return np.einsum("nji,nj->ni", self.basis[k], point - self.centre[k])

    def points(self, x: Array) -> list[tuple[Array, Array]]:
        """First and last point of contact with every node, in the base."""
        found = []
        for k, (node, share) in enumerate(zip(self.nodes, self.shares(x), strict=True)):
            centre, leave = self.centre[k], self.exits[k]
            if node.unknowns == 0:
                found.append((centre, centre if leave is None else leave))
            else:
                first, last = contacts(node, share)
                turned = [np.einsum("nij,nj->ni", self.basis[k], p) for p in (first, last)]
                found.append((centre + turned[0], centre + turned[1]))
        return found

    def around(self, k: int, points: list[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Neighbouring points of contact of node k, in its own axes."""
        if k == 0:
            far = self.local(k, points[1][0])
            return far, far
        before = self.local(k, points[k - 1][1])
        return before, before if k == len(points) - 1 else self.local(k, points[k + 1][0])

    def residual(self, x: Array) -> Array:
        points, residuals = self.points(x), []
        for k, (node, share) in enumerate(zip(self.nodes, self.shares(x), strict=True)):
            if node.unknowns:
                residuals += equations(node, share, *self.around(k, points))
        return np.stack(residuals, axis=1)

    def crude(self) -> Array:
        """Unknowns of the first pose, every body seen from the middles of its neighbours."""
        one, shares = self.part(slice(0, 1)), []
        middles = [(c, c if e is None else e) for c, e in zip(one.centre, one.exits, strict=True)]
        for k, node in enumerate(self.nodes):
            if node.unknowns:
                a, b = one.around(k, middles)
                shares.append(guess(node, a[0], b[0], k == len(self.nodes) - 1))
        return np.concatenate(shares)[None] if shares else np.empty((1, 0))

    def solve(self, x: Array) -> Array:
        """Newton's method from the guess x, at all poses.

        Raises:
            ValueError: it does not converge.
        """
        if self.size == 0:
            return x
        jacobian = None
        for _ in range(60):
            residual = self.residual(x)
            if jacobian is None:
                columns = [
                    (self.residual(x + STEP * e) - self.residual(x - STEP * e)) / (2.0 * STEP)
                    for e in np.eye(self.size)
                ]
                jacobian = np.stack(columns, axis=2)
            step = np.linalg.solve(jacobian, residual[..., None])[..., 0]
            largest = np.abs(step).max()
            x = x - step * min(1.0, 0.3 / max(largest, 1e-300))
            if largest < 1e-12:
                return x
            if largest > 1e-5:
                jacobian = None
        raise ValueError(f"no path: the last step is {largest:.1e}")

    def follow(self) -> Array:
        """Unknowns of all poses along a motion, shape (n, unknowns)."""
        count = len(self.centre[0])
        knots = np.unique(np.append(np.arange(0, count, STRIDE), count - 1))
        found = [self.part(knots[:1]).solve(self.crude())]
        for k in range(1, knots.size):
            ahead = found[-1] if k < 2 else 2.0 * found[-1] - found[-2]
            found.append(self.part(knots[k : k + 1]).solve(ahead))
        known = np.concatenate(found)
        start = [np.interp(np.arange(count), knots, column) for column in known.T]
        return self.solve(np.stack(start, axis=1) if start else np.empty((count, 0)))


def _basis(node: Node, pose: Pose) -> Array:
    if node.axis is None:
        return pose.turn
    z = np.asarray(node.axis) / np.linalg.norm(node.axis)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return pose.turn @ np.stack([x, np.cross(z, x), z], axis=1)


def _chain(nodes: Sequence[Node], poses: Mapping[str, Pose]) -> _Chain:
    three = [(*node.position, 0.0)[:3] for node in nodes]
    return _Chain(
        tuple(nodes),
        tuple(poses[n.frame].point(p) for n, p in zip(nodes, three, strict=True)),
        tuple(_basis(node, poses[node.frame]) for node in nodes),
        tuple(poses[n.exit_frame].point(n.exit) if n.kind == "sheath" else None for n in nodes),
    )


def find_path(nodes: Sequence[Node], poses: Mapping[str, Pose]) -> Path:
    """The path of a cable at all poses of a motion.

    Only spheres may be left by the cable; which of them it touches is found from pose to pose:
    one whose wrap would be negative is left, one through which a straight span passes is touched.

    Raises:
        ValueError: there is no path.
    """
    chain = _chain(nodes, poses)
    count = len(chain.centre[0])
    spheres = [k for k, node in enumerate(nodes) if node.kind == "sphere"]
    off = {k: _passes_free(chain, k) for k in spheres}
    parts = np.zeros(count, dtype=int)
    for power, k in enumerate(spheres):
        parts += 2**power * off[k]
    result = _Empty(len(nodes), count)
    for run in np.split(np.arange(count), np.flatnonzero(np.diff(parts)) + 1):
        free = {k for power, k in enumerate(spheres) if parts[run[0]] >> power & 1}
        kept = [k for k in range(len(nodes)) if k not in free]
        some = _Chain(
            tuple(nodes[k] for k in kept),
            tuple(chain.centre[k][run] for k in kept),
            tuple(chain.basis[k][run] for k in kept),
            tuple(None if (e := chain.exits[k]) is None else e[run] for k in kept),
        )
        result.fill(run, kept, some, some.follow())
    return result.path()


def _passes_free(chain: _Chain, k: int) -> NDArray[np.bool_]:
    """Where the straight line between the neighbours of a sphere, both points, does not touch it.

    It neither passes through the sphere nor behind it, as seen from the side of the cable.
    """
    if not (chain.nodes[k - 1].is_point and chain.nodes[k + 1].is_point):
        raise ValueError("the neighbours of a sphere must be points")
    a, b = chain.local(k, chain.centre[k - 1]), chain.local(k, chain.centre[k + 1])
    way = b - a
    foot = np.clip(-np.sum(a * way, -1) / np.sum(way * way, -1), 0.0, 1.0)
    nearest = a + foot[:, None] * way
    node = chain.nodes[k]
    side = np.asarray(node.side) - np.asarray(node.position)
    outside = np.linalg.norm(nearest, axis=-1) >= node.radius
    return np.asarray(outside & (nearest @ side > 0.0))


class _Empty:
    """The arrays of a path, filled run by run."""

    def __init__(self, nodes: int, count: int) -> None:
        spans, bodies = nodes - 1, nodes - 2
        self.span = np.zeros((count, spans))
        self.direction, self.begin, self.end = (np.zeros((count, spans, 3)) for _ in range(3))
        self.first, self.last, self.wrap = (np.zeros((count, bodies)) for _ in range(3))
        self.touching = np.zeros((count, bodies), dtype=bool)
        self.wound = np.zeros((count, 2))

    def path(self) -> Path:
        return Path(
            self.span, self.direction, self.begin, self.end, self.first, self.last, self.wrap,
            self.touching, self.wound,
        )  # fmt: skip

    def fill(self, run: NDArray[np.intp], kept: list[int], chain: _Chain, x: Array) -> None:
        """Write the poses of ``run``, at which the cable touches the nodes ``kept``."""
        points, shares = chain.points(x), chain.shares(x)
        for j in range(len(kept) - 1):
            begin, end = points[j][1], points[j + 1][0]
            way = end - begin
            length = np.linalg.norm(way, axis=-1)
            for k in range(kept[j], kept[j + 1]):
                self.direction[run, k] = way / length[:, None]
                self.begin[run, k] = begin if k == kept[j] else end
                self.end[run, k] = end
            self.span[run, kept[j]] = length
        for j, k in enumerate(kept):
            if 0 < k < self.span.shape[1]:
                ways = self.direction[run, k - 1], self.direction[run, k]
                self.touching[run, k - 1] = True
                places = _places(chain, j, points[j], shares[j], ways)
                self.first[run, k - 1], self.last[run, k - 1], self.wrap[run, k - 1] = places
        for end, j in enumerate((0, -1)):
            node = chain.nodes[j]
            if node.kind in ENDS and node.unknowns:
                laid = node.radius * node.turn * (shares[j][:, 0] - shares[j][0, 0])
                self.wound[run, end] = laid if end == 0 else -laid


def _places(
    chain: _Chain, j: int, points: tuple[Array, Array], x: Array, ways: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Places of the points of contact on the surface, and the wrap."""
    node = chain.nodes[j]
    r, zero = node.radius, np.zeros(len(x))
    if node.kind == "eyelet":
        cross = np.linalg.norm(np.cross(*ways), axis=-1)
        return zero, zero, np.arctan2(cross, np.sum(ways[0] * ways[1], -1))
    if node.kind == "sheath":
        return zero, zero + node.length, zero + node.bend
    if node.kind == "swivel":
        return zero, r * x[:, 1], x[:, 1]
    if node.kind == "pulley":
        return r * node.turn * x[:, 0], r * node.turn * x[:, 1], node.turn * (x[:, 1] - x[:, 0])
    if node.kind == "cylinder":
        angle = node.turn * (x[:, 1] - x[:, 0])
        rise = x[:, 3] - x[:, 2]
        lean = np.arctan(
            np.sum(ways[0] * chain.basis[j][:, :, 2], -1)
            / np.linalg.norm(np.cross(ways[0], chain.basis[j][:, :, 2]), axis=-1)
        )
        arc = np.hypot(r * angle, rise)
        middle = 0.5 * (lean[1:] + lean[:-1])
        moved = [
            np.cos(middle) * r * node.turn * np.diff(x[:, e])
            + np.sin(middle) * np.diff(x[:, 2 + e])
            for e in (0, 1)
        ]
        return *_joined(moved, arc), angle * np.cos(lean)
    normals = x[:, :3], x[:, 3:]
    tangents = [np.einsum("nji,nj->ni", chain.basis[j], way) for way in ways]
    wrap = np.arctan2(np.sum(tangents[0] * normals[1], -1), np.sum(normals[0] * normals[1], -1))
    moved = []
    for normal, tangent in zip(normals, tangents, strict=True):
        half = np.arcsin(0.5 * np.linalg.norm(np.diff(tangent, axis=0), axis=-1))
        stretch = 1.0 / np.sinc(2.0 * half / np.pi)  # of an arc over r sin(angle)
        mean = 0.5 * (tangent[1:] + tangent[:-1])
        moved.append(r * stretch * np.sum(mean * np.diff(normal, axis=0), -1))
    return *_joined(moved, r * wrap), wrap


def _joined(moved: list[Array], arc: Array) -> tuple[Array, Array]:
    """Places of both ends of a geodesic from their motion along it, as long as the arc is."""
    excess = np.diff(arc) - (moved[1] - moved[0])
    middle = np.cumsum(np.concatenate([[0.0], moved[0] - 0.5 * excess]))
    return middle, middle + arc
