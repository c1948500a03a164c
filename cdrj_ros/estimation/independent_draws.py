"""Random numbers of the ensemble's members that are not correlated with what is known of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


def standard(generator: np.random.Generator, members: int, apart: Sequence[Vector] = ()) -> Vector:
    """Random numbers with mean 0 and variance 1 over the members, shape (members,).

    Args:
        generator: random generator.
        members: number of members.
        apart: values in every member with which they are not correlated.  Since members are few,
            they would be by chance, and every correction would reduce the spread of these values.
    """
    normal = generator.standard_normal(members)
    if len(apart) < members // 2:
        basis = _basis(members, b"".join([one.tobytes() for one in apart]))
        normal -= basis @ (basis.T @ normal)
    else:
        normal -= normal.mean()
    normal /= root_mean_square(normal)
    return normal


@lru_cache(maxsize=8)
def _basis(members: int, apart: bytes) -> Table:
    """Orthonormal basis of a constant and of the vectors that ``apart`` holds, (members, vectors).

    Several draws follow each other with the same vectors.  To decompose them takes ten times as
    long as to compare them.
    """
    vectors = np.ones((1 + len(apart) // (8 * members), members))
    vectors[1:] = np.frombuffer(apart).reshape(-1, members)
    return np.linalg.qr(vectors.T)[0]


def root_mean_square(values: Vector) -> float:
    """Standard deviation of values with mean 0."""
    return sqrt(np.add.reduce(values * values) / values.size)
