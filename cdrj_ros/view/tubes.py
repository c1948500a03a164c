"""Cables as tubes: meshes around their paths."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Faces = NDArray[np.uint32]

SIDES: Final = 8
"""Number of flat sides of a tube."""

POINTS: Final = 33
"""Number of points of a tube's centre line, so that its faces never change."""


def tube(path: Points, radius: float) -> tuple[Points, Faces]:
    """Mesh of one tube along a path.

    Args:
        path: centre line [m], shape (n, 3).
        radius: [m].

    Returns:
        Vertices [m], shape (POINTS * SIDES, 3), and faces, shape (f, 3).
    """
    at = np.linspace(0.0, len(path) - 1.0, POINTS)  # dense where the path is, on the arcs
    line = np.column_stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in range(3)])
    return _around(line[None], radius), _faces(1, POINTS)


def dashed_tube(ends: Points, radius: float) -> tuple[Points, Faces]:
    """Mesh of dashes.

    Args:
        ends: first and last point of every dash in turn [m], shape (2 * dashes, 3).
        radius: [m].

    Returns:
        Vertices [m], shape (2 * dashes * SIDES, 3), and faces, shape (f, 3).
    """
    dashes = len(ends) // 2
    return _around(ends.reshape(dashes, 2, 3), radius), _faces(dashes, 2)


def disc(centre: Points, radius: float, thickness: float, sides: int = 32) -> tuple[Points, Faces]:
    """Mesh of a disc across the z axis.

    Args:
        centre: [m], shape (3,).
        radius: [m].
        thickness: along the z axis [m].
        sides: number of flat sides of the rim.

    Returns:
        Vertices [m], shape (2 * sides + 2, 3), and faces, shape (f, 3).
    """
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(sides)])
    half = np.array([0.0, 0.0, 0.5 * thickness])
    vertices = np.concatenate([rim - half, rim + half, -half[None], half[None]]) + centre
    a = np.arange(sides)
    b, under, over = (a + 1) % sides, np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    triangles = [(a, b, a + sides), (b, b + sides, a + sides), (b, a, under)]
    triangles.append((a + sides, b + sides, over))
    faces = np.concatenate([np.column_stack(triangle) for triangle in triangles])
    return vertices, faces.astype(np.uint32)


def _around(lines: NDArray[np.float64], radius: float) -> Points:
    """Rings around every point of several lines, shape (lines, points, 3)."""
    along = np.gradient(lines, axis=1)
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
    # the axis that is farthest from parallel to any piece is across all of them
    axis = np.eye(3)[np.argmin(np.abs(along).max(axis=(0, 1)))]
    across = np.cross(along, axis)
    size = np.linalg.norm(across, axis=-1, keepdims=True)
    across = np.divide(across, size, out=np.zeros_like(across), where=size > 1e-9)
    other = np.cross(along, across)
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)[:, None]
    rings = np.cos(angle) * across[:, :, None] + np.sin(angle) * other[:, :, None]
    return np.asarray((lines[:, :, None] + radius * rings).reshape(-1, 3))


@cache
def _faces(lines: int, points: int) -> Faces:
    """Two triangles per side between neighbouring rings."""
    ring, side = np.meshgrid(np.arange(points - 1), np.arange(SIDES), indexing="ij")
    following = (side + 1) % SIDES
    a, b = ring * SIDES + side, ring * SIDES + following
    one = np.stack([a, a + SIDES, b, b, a + SIDES, b + SIDES], axis=-1).reshape(-1, 3)
    offsets = np.arange(lines)[:, None, None] * points * SIDES
    faces = (one[None] + offsets).reshape(-1, 3).astype(np.uint32)
    faces.setflags(write=False)
    return faces
