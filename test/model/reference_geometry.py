"""Geometry of a cable in one pose: what it consists of, and that of cables by tables.

In plain NumPy, by section 3 of docs/model.md, without the compiled core.  Derivatives are complex
steps.  ``reference_in_space`` has cables by positions.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

STEP = 1e-100
"""Imaginary step of a derivative; its square vanishes."""


@dataclass(frozen=True)
class Geometry:
    """All cables in one pose."""

    length: Vector
    """L_i [m], shape (elements,)."""
    arm: NDArray[np.float64]
    """a_ij of (E27) [m], shape (elements, joints)."""
    wrap: Vector
    """beta [rad], shape (pulleys,)."""
    direction: NDArray[np.float64]
    """u_i of cables given by positions, shape (elements, 3)."""
    arc: Vector
    """Cable on every pulley [m], shape (pulleys,)."""
    middle: Vector
    """Place of the middle of the arc on its body [m], shape (pulleys,), up to a constant."""
    drum: Vector
    """Moment of a cable about the axis of either end, per newton [m], shape (2 cables,)."""
    laid: Vector
    """Cable that has come onto either end since the reference pose, its motor at rest [m], shape
    (2 cables,)."""


def by_tables(robot, cable, q):
    """Sums of functions of single joints, the arcs of (E6), and the middles of these arcs."""
    span, wrap = (part.real for part in _sums(robot, cable, q + 0j))
    radius = np.array([pulley.radius for pulley in cable.pulleys])
    length, arcs = span.copy(), radius * wrap
    length[:-1] += 0.5 * arcs
    length[1:] += 0.5 * arcs
    # from the end that rests, half of the arc towards the one that moves
    way = {"before": -0.5, "both": 0.0, "after": 0.5}
    middle = np.array([way[pulley.moving_end] for pulley in cable.pulleys]) * arcs
    arms = np.zeros((length.size, q.size))
    for j in range(q.size):
        moved = q + 0j
        moved[j] += 1j * STEP
        arms[:, j] = _free(robot, cable, moved).imag / STEP
    ends = np.array([cable.nodes[0].radius, cable.nodes[-1].radius])
    return Geometry(length, arms, wrap, np.zeros((span.size, 3)), arcs, middle, ends, 0.0 * ends)


def _free(robot, cable, q):
    """Free lengths if arcs did not grow: what is laid on comes off the moving end."""
    span, wrap = _sums(robot, cable, q)
    for k, pulley in enumerate(cable.pulleys):
        arc = pulley.radius * wrap[k]
        share = {"before": 1.0, "both": 0.5, "after": 0.0}[pulley.moving_end]
        span[k] += share * arc
        span[k + 1] += (1.0 - share) * arc
    return span


def _sums(robot, cable, q):
    """Free lengths and wraps."""
    joints = {joint.name: k for k, joint in enumerate(robot.joints)}

    def total(profiles):
        return sum((tabled(p, q[joints[p.joint]] if p.joint else 0j) for p in profiles), 0j)

    span = np.array([total(span) for span in cable.spans])
    return span, np.array([total(pulley.wrap) for pulley in cable.pulleys], complex)


def tabled(profile, q):
    """Cubic Hermite interpolation of values and slopes."""
    if profile.joint is None:
        return complex(profile.value[0])
    grid, value, slope = profile.angle, profile.value, profile.slope
    h = grid[1] - grid[0]
    k = int(np.clip((q.real - grid[0]) / h, 0, grid.size - 2))
    u = (q - grid[0]) / h - k
    return complex(
        (1 + 2 * u) * (1 - u) ** 2 * value[k]
        + u * (1 - u) ** 2 * h * slope[k]
        + u**2 * (3 - 2 * u) * value[k + 1]
        + u**2 * (u - 1) * h * slope[k + 1]
    )
