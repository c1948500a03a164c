"""Stiffness of a cable over pulleys: (11)-(28), with the blocks that the source omits.

A cable of n nodes in space has n - 1 elements; element i runs from node i to node i + 1 along the
unit vector u_i.  The unknowns are the displacements of all nodes and the slips of the n - 2
pulleys; the slip of a pulley is the material that has moved past it towards the last node.  The
pull of the cable on node i and the imbalance at pulley i are

    F_i = t_i u_i - t_{i-1} u_{i-1}                                            from (12)
    r_i = t_i - eta_i t_{i-1}    where it slips towards the first node         (24)
    r_i = eta_i t_i - t_{i-1}    where it slips towards the last node

and K = -d(F, r) / d(displacement, slip), so that (27) reads (T - F, T_0) = K (Delta, S).
See examples/paper/derivation.md, section 1, and examples/paper/equations.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.laws import Elasticity, modulus_at, strain_at

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@dataclass(frozen=True)
class Stiffness:
    """K of (28) and its blocks; n nodes in d dimensions, displacements ordered node by node."""

    matrix: Table
    """K, shape (d n + n - 2, d n + n - 2)."""
    nodes: int
    """n."""
    dimensions: int
    """d, 2 or 3."""

    @property
    def node_by_node(self) -> Table:
        """K_DD of (20) [N/m], shape (d n, d n)."""
        return self.matrix[: self._split, : self._split]

    @property
    def node_by_slip(self) -> Table:
        """K_Ds of (20) [N/m], shape (d n, n - 2)."""
        return self.matrix[: self._split, self._split :]

    @property
    def slip_by_node(self) -> Table:
        """K_sD of (26) [N/m], shape (n - 2, d n)."""
        return self.matrix[self._split :, : self._split]

    @property
    def slip_by_slip(self) -> Table:
        """K_ss of (26) [N/m], tridiagonal, shape (n - 2, n - 2)."""
        return self.matrix[self._split :, self._split :]

    @property
    def _split(self) -> int:
        return self.nodes * self.dimensions

    def slips(self, displacement: Table) -> Vector:
        """(26) solved for S [m]: the slips that keep every pulley in balance.

        Args:
            displacement: of the nodes from a balanced state [m], shape (n, d).

        Raises:
            UsageError: with slack elements the slips are undetermined.
        """
        try:
            return np.linalg.solve(
                self.slip_by_slip, -self.slip_by_node @ np.ravel(displacement)
            ).astype(np.float64)
        except np.linalg.LinAlgError:
            raise UsageError("slack elements leave the slips undetermined") from None

    def condensed(self) -> Table:
        """K_DD - K_Ds K_ss^-1 K_sD [N/m]: the nodes' stiffness with the pulleys in balance.

        Raises:
            UsageError: with slack elements the slips are undetermined.
        """
        try:
            following = np.linalg.solve(self.slip_by_slip, self.slip_by_node)
        except np.linalg.LinAlgError:
            raise UsageError("slack elements leave the slips undetermined") from None
        return self.node_by_node - self.node_by_slip @ following


def nominal_stiffness(axial_stiffness: float, length: Vector) -> Vector:
    """(14): k = EA / L [N/m]."""
    return axial_stiffness / length


def exact_stiffness(elastic: Elasticity, length: Vector, tension: Vector) -> tuple[Vector, Vector]:
    """dt/dL and -dt/dl of an element [N/m], (E16).

    In a linear cable they are k (1 + t / EA) and k (1 + t / EA)^2; to first order both equal (14).

    Args:
        elastic: tension-strain law of the cable.
        length: geometric lengths [m].
        tension: of the elements, taut [N].
    """
    stretch = 1.0 + strain_at(elastic, tension)
    nominal = modulus_at(elastic, tension) / length
    return nominal * stretch, nominal * stretch**2


def linear_tension(preload: Vector, stiffness: Vector, elongation: Vector, slip: Vector) -> Vector:
    """(11) with (13): t = max(t_0 + k (elongation - s_i + s_{i+1}), 0) [N].

    Args:
        preload: t_0 of the elements [N], shape (n - 1,).
        stiffness: k of the elements [N/m], shape (n - 1,).
        elongation: of the elements, u_{i+1} - u_i [m], shape (n - 1,).
        slip: at all nodes, shape (n,); 0 at an end that holds its cable [m].
    """
    return np.maximum(preload + stiffness * (elongation + np.diff(slip)), 0.0)


def stiffness_matrix(
    position: Table,
    tension: Vector,
    by_length: Vector,
    by_material: Vector | None = None,
    transmission: Vector | None = None,
    direction: Vector | None = None,
    geometric: bool = True,
) -> Stiffness:
    """(12), (15)-(28), (E15): K of one cable, assembled element by element.

    Args:
        position: of the nodes [m], shape (n, d), d = 2 or 3.
        tension: of the elements [N], shape (n - 1,).  An element without tension is slack and
            has no stiffness: Gamma+ of (11).
        by_length: dt/dL of the elements [N/m], shape (n - 1,); k of (14), or ``exact_stiffness``.
        by_material: -dt/dl of the elements [N/m]; ``by_length`` where not given.
        transmission: eta of the pulleys in (0, 1], shape (n - 2,); 1 where not given.
        direction: of the pulleys' slip, +1 towards the last node, -1 towards the first (the
            source's case (24)), shape (n - 2,); -1 where not given.
        geometric: include the rotation of the elements, t / L (I - u u^T), which makes K the
            negative derivative of the forces; without it K is (19) as in the source.

    Raises:
        UsageError: a wrong shape, coincident nodes, or a value out of its range.
    """
    x = _positions(position)
    n, d = x.shape
    t = _sized("tension", tension, n - 1)
    if not np.all(t >= 0.0):
        raise UsageError("tension must not be negative")
    k_length, k_material = _slopes(t, by_length, by_material)
    ahead, behind = _weights(*_pulleys(n - 2, transmission, direction))
    chord = np.diff(x, axis=0)
    length = np.linalg.norm(chord, axis=1)
    if not np.all(length > 0.0):
        raise UsageError("neighbouring nodes coincide")

    matrix = np.zeros((d * n + n - 2, d * n + n - 2))
    for i in range(n - 1):
        u = chord[i] / length[i]  # lambda of (17)
        by_node = np.concatenate([-u, u]) * k_length[i]  # dt_i by both ends
        pull = np.concatenate([u, -u])  # of the element on its ends, per newton
        ends = slice(d * i, d * (i + 2))
        matrix[ends, ends] -= np.outer(pull, by_node)  # k_DD of (19)
        if geometric:
            matrix[ends, ends] += _turning(u, t[i] / length[i])
        # the slip of the pulley at the first node adds material, that at the last node removes it
        pulleys = [
            (d * n + p, sign, weight[p])
            for p, sign, weight in ((i - 1, -1.0, ahead), (i, 1.0, -behind))
            if 0 <= p < n - 2
        ]
        for column, sign, _ in pulleys:
            matrix[ends, column] -= pull * sign * k_material[i]  # k_Ds of (19)
        for row, _, weight in pulleys:
            matrix[row, ends] -= weight * by_node  # (25)
            for column, sign, _ in pulleys:
                matrix[row, column] -= weight * sign * k_material[i]
    return Stiffness(matrix, n, d)


def imbalance(tension: Vector, transmission: Vector, direction: Vector) -> Vector:
    """r of (24), (E14) at every pulley [N], shape (n - 2,): 0 where slipping and in balance."""
    t = np.asarray(tension)
    ahead, behind = _weights(np.asarray(transmission), np.asarray(direction))
    return ahead * t[1:] - behind * t[:-1]


def _weights(transmission: Vector, direction: Vector) -> tuple[Vector, Vector]:
    """Factors in (24), (E14) of the tensions after and before a pulley; eta is at the pull."""
    forward = direction > 0.0
    return np.where(forward, transmission, 1.0), np.where(forward, 1.0, transmission)


def _positions(position: Table) -> Table:
    """Node positions [m], shape (n, d), checked."""
    x = np.asarray(position, dtype=np.float64)
    if x.ndim != 2 or x.shape[0] < 2 or x.shape[1] not in (2, 3):
        raise UsageError(f"position must have the shape (n, 2) or (n, 3), got {x.shape}")
    return x


def _slopes(
    tension: Vector, by_length: Vector, by_material: Vector | None
) -> tuple[Vector, Vector]:
    """dt/dL and -dt/dl of the elements [N/m], 0 where an element is slack: Gamma+ of (11)."""
    count, taut = tension.size, tension > 0.0
    length = np.where(taut, _sized("by_length", by_length, count), 0.0)
    if by_material is None:
        return length, length
    return length, np.where(taut, _sized("by_material", by_material, count), 0.0)


def _pulleys(
    count: int, transmission: Vector | None, direction: Vector | None
) -> tuple[Vector, Vector]:
    """Transmission and direction of the pulleys, checked, with their defaults."""
    eta = np.ones(count) if transmission is None else _sized("transmission", transmission, count)
    way = np.full(count, -1.0) if direction is None else _sized("direction", direction, count)
    if not (np.all(eta > 0.0) and np.all(eta <= 1.0)):
        raise UsageError("transmission must be in (0, 1]")
    if not np.all(np.abs(way) == 1.0):
        raise UsageError("direction must be +1 or -1")
    return eta, way


def _turning(u: Vector, tension_by_length: float) -> Table:
    """g of (E15) for both ends [N/m]: stiffness against rotation, t / L (I - u u^T)."""
    across = tension_by_length * (np.eye(u.size) - np.outer(u, u))
    return np.kron([[1.0, -1.0], [-1.0, 1.0]], across).astype(np.float64)


def _sized(name: str, values: Vector, size: int) -> Vector:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (size,):
        raise UsageError(f"{name} must have the shape ({size},), got {array.shape}")
    return array
