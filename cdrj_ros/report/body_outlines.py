"""Outlines of pulleys, cylinders and spheres in space, as lines."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.spatial_paths import Body

Points = NDArray[np.float64]

CIRCLE_POINTS: Final = 49
"""Points of a drawn circle, the first one twice."""

GENERATORS: Final = 6
"""Lines along a drawn cylinder."""


def outlines(body: Body) -> list[Points]:
    """Lines that show a body, each of shape (points, 3) [m].

    A pulley is a circle, a sphere three great circles; a cylinder is drawn a little further than
    the cable touches it.
    """
    x, y, z = body.basis
    if body.kind == "sphere":
        return [_circle(body, body.centre, u, v) for u, v in ((x, y), (y, z), (z, x))]
    if body.kind == "pulley":
        return [_circle(body, body.centre, x, y)]
    low, high = _heights(body)
    ends = [_circle(body, body.centre + height * z, x, y) for height in (low, high)]
    step = (CIRCLE_POINTS - 1) // GENERATORS
    return [*ends, *(np.array([ends[0][k], ends[1][k]]) for k in range(0, CIRCLE_POINTS - 1, step))]


def _heights(body: Body) -> tuple[float, float]:
    """Lower and upper end of a drawn cylinder along its axis, from its centre [m]."""
    touched = (body.points - body.centre) @ body.basis[2] if len(body.points) else np.zeros(1)
    return float(touched.min()) - body.radius, float(touched.max()) + body.radius


def _circle(body: Body, centre: Points, u: Points, v: Points) -> Points:
    angles = np.linspace(0.0, 2.0 * pi, CIRCLE_POINTS)
    points: Points = centre + body.radius * (
        np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
    )
    return points
