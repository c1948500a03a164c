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

from cdrj_ros.foundation.arrays import Matrix, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.laws import Elasticity, modulus_at, strain_at


@dataclass(frozen=True)
class Stiffness:
    """K of (28) and its blocks, displacements ordered node by node."""

    matrix: Matrix
    """K, shape (d n + n - 2, d n + n - 2), for n nodes in d dimensions."""
    split: int
    """d n."""

    @property
    def node_by_node(self) -> Matrix:
        """K_DD of (20) [N/m], shape (d n, d n)."""
        return self.matrix[: self.split, : self.split]

    @property
    def slip_by_node(self) -> Matrix:
        """K_sD of (26) [N/m], shape (n - 2, d n)."""
        return self.matrix[self.split :, : self.split]

    @property
    def slip_by_slip(self) -> Matrix:
        """K_ss of (26) [N/m], tridiagonal, shape (n - 2, n - 2)."""
        return self.matrix[self.split :, self.split :]


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
    position: Matrix,
    tension: Vector,
    by_length: Vector,
    by_material: Vector,
    transmission: Vector,
    direction: Vector,
    geometric: bool = True,
) -> Stiffness:
    """(12), (15)-(28), (E15): K of one cable, assembled element by element.

    Args:
        position: of the nodes [m], shape (n, d), d = 2 or 3.
        tension: of the elements [N], shape (n - 1,).  An element without tension is slack and
            has no stiffness: Gamma+ of (11).
        by_length: dt/dL of the elements [N/m], shape (n - 1,); k of (14), or ``exact_stiffness``.
        by_material: -dt/dl of the elements [N/m], as well.
        transmission: eta of the pulleys in (0, 1], shape (n - 2,).
        direction: of the pulleys' slip, +1 towards the last node, -1 towards the first (the
            source's case (24)), shape (n - 2,).
        geometric: include the rotation of the elements, t / L (I - u u^T), which makes K the
            negative derivative of the forces; without it K is (19) as in the source.

    Raises:
        UsageError: coincident nodes, or a transmission out of its range.
    """
    if not np.all((transmission > 0.0) & (transmission <= 1.0)):
        raise UsageError("transmission must be in (0, 1]")
    n, d = position.shape
    ahead, behind = _weights(transmission, direction)
    taut = tension > 0.0
    chord = np.diff(position, axis=0)
    length = np.linalg.norm(chord, axis=1)
    if not np.all(length > 0.0):
        raise UsageError("neighbouring nodes coincide")
    matrix = np.zeros((d * n + n - 2, d * n + n - 2))
    for i in range(n - 1):
        u = chord[i] / length[i]  # lambda of (17)
        by_node = np.concatenate([-u, u]) * taut[i] * by_length[i]  # dt_i by both ends
        pull = np.concatenate([u, -u])  # of the element on its ends, per newton
        ends = slice(d * i, d * (i + 2))
        matrix[ends, ends] -= np.outer(pull, by_node)  # k_DD of (19)
        if geometric:  # g of (E15)
            turning = tension[i] / length[i] * (np.eye(d) - np.outer(u, u))
            matrix[ends, ends] += np.kron([[1.0, -1.0], [-1.0, 1.0]], turning)
        # the slip of the pulley at the first node adds material, that at the last node removes it
        pulleys = [
            (d * n + p, sign * taut[i] * by_material[i], weight[p])
            for p, sign, weight in ((i - 1, -1.0, ahead), (i, 1.0, -behind))
            if 0 <= p < n - 2
        ]
        for column, by_slip, _ in pulleys:
            matrix[ends, column] -= pull * by_slip  # k_Ds of (19)
        for row, _, weight in pulleys:
            matrix[row, ends] -= weight * by_node  # (25)
            for column, by_slip, _ in pulleys:
                matrix[row, column] -= weight * by_slip
    return Stiffness(matrix, d * n)


def imbalance(tension: Vector, transmission: Vector, direction: Vector) -> Vector:
    """r of (24), (E14) at every pulley [N], shape (n - 2,): 0 where slipping and in balance."""
    ahead, behind = _weights(transmission, direction)
    return ahead * tension[1:] - behind * tension[:-1]


def _weights(transmission: Vector, direction: Vector) -> tuple[Vector, Vector]:
    """Factors in (24), (E14) of the tensions after and before a pulley; eta is at the pull."""
    forward = direction > 0.0
    return np.where(forward, transmission, 1.0), np.where(forward, 1.0, transmission)
