"""Shapes of bodies in a pose, as they are drawn pale behind the cables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from itertools import product
from math import pi, sqrt
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Faces, Points, Vector
from cdrj_ros.foundation.files import InputError, read_regular
from cdrj_ros.robot.visuals import MESHES, Visual, VisualShape

FramePose = tuple[Vector, NDArray[np.float64]]
"""Origin [m] and orientation of a frame in the base, shapes (3,) and (3, 3)."""

Wxyz = tuple[float, float, float, float]
"""A unit quaternion: w, x, y, z."""

LARGEST_MESH: Final = 20_000_000
"""Largest file of a mesh that is read [bytes]."""

MOST_FACES: Final = 200_000
"""Largest number of triangles of a mesh that is drawn."""

SIDES: Final = 32
"""Corners of a drawn circle."""


class Mesh(NamedTuple):
    """Triangles."""

    vertices: Points
    """Shape (n, 3)."""
    faces: Faces
    """Indices of vertices, shape (f, 3)."""


@dataclass(frozen=True, eq=False)
class PlacedVisual:
    """A shape in the base."""

    shape: VisualShape
    size: Vector
    """As of ``Visual``, shape (3,)."""
    centre: Vector
    """[m], shape (3,)."""
    rotation: NDArray[np.float64]
    """Shape (3, 3)."""
    mesh: str

    @property
    def points(self) -> Points:
        """Points [m] whose convex hull contains it, shape (n, 3); none of an unknown mesh."""
        return self.centre + _own_points(self.shape, self.mesh) * self.size @ self.rotation.T

    @property
    def quaternion(self) -> Wxyz:
        """Its orientation."""
        from scipy.spatial.transform import Rotation  # slow

        x, y, z, w = map(float, Rotation.from_matrix(self.rotation).as_quat())
        return w, x, y, z


def quaternion_to(axis: Vector) -> Wxyz:
    """The rotation that turns the z axis to a unit vector, shape (3,)."""
    x, y, z = map(float, axis)
    if z < -1.0 + 1e-12:
        return 0.0, 1.0, 0.0, 0.0
    w = sqrt(0.5 * (1.0 + z))
    return w, -0.5 * y / w, 0.5 * x / w, 0.0


def placed_visuals(
    visuals: Sequence[Visual], frames: Mapping[str, FramePose]
) -> Iterator[PlacedVisual]:
    """The visuals of a robot, in the base.

    Args:
        visuals: of the robot.
        frames: pose of every frame in the base.
    """
    for one in visuals:
        origin, turned = frames[one.frame]
        yield PlacedVisual(
            one.shape, np.array(one.size), origin + turned @ np.array(one.origin),
            turned @ np.reshape(one.rotation, (3, 3)), one.mesh,
        )  # fmt: skip


@lru_cache(maxsize=256)
def mesh_in(path: str) -> Mesh | None:
    """The mesh in a file; None where none can be read, or trimesh is not installed."""
    try:
        import trimesh
    except ImportError:
        return None
    suffix = Path(path).suffix.lower()
    try:
        if suffix not in MESHES:
            return None
        data = BytesIO(read_regular(path, LARGEST_MESH))
        found: Any = trimesh.load(data, file_type=suffix[1:], force="mesh")
        vertices, faces = np.array(found.vertices, float), np.array(found.faces, np.uint32)
    except InputError:
        return None
    except Exception:  # noqa: BLE001 whatever a library says of a broken file
        return None
    if not len(faces) or len(faces) > MOST_FACES or not np.isfinite(vertices).all():
        return None
    return Mesh(vertices, faces)


def _own_points(shape: VisualShape, mesh: str) -> Points:
    """Points of a shape of size 1."""
    if shape == "mesh":
        known = mesh_in(mesh)
        return np.empty((0, 3)) if known is None else known.vertices
    if shape == "box":
        return np.array(list(product((-0.5, 0.5), repeat=3)))
    angle = np.linspace(0.0, 2.0 * pi, SIDES, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)])
    if shape == "cylinder":
        half = np.array([0.0, 0.0, 0.5])
        return np.concatenate([circle - half, circle + half])
    heights = np.sin(angle)[:, None, None]
    rings = np.sqrt(1.0 - heights**2) * circle + heights * np.array([0.0, 0.0, 1.0])
    return np.asarray(rings.reshape(-1, 3))
