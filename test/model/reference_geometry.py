"""Lengths, wraps and directions of cables in the plane, by section 3 of docs/model.md.

In plain NumPy, without the compiled core.  A lever arm is the derivative of the distance of the
two points between which a cable runs free, each of which rests in its body: a complex step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.robot.description import Cable, Profile, Robot
from cdrj_ros.robot.space import Frame

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]

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
    """Place of the middle of the arc on its body [m], shape (pulleys,), up to a constant and to
    whole turns."""
    drum: Vector
    """Moment of a cable about the axis of either end, per newton [m], shape (2 cables,)."""
    laid: Vector
    """Cable that has come onto either end since the reference pose, its motor at rest [m], shape
    (2 cables,)."""


def plane(robot: Robot, q: Vector) -> Geometry:
    """(E4) to (E6) or the sums of tables, (E26) and (E27)."""
    parts = [
        _positions(robot, cable, q.astype(complex))
        if cable.placed
        else _tables(robot, cable, q.astype(complex))
        for cable in robot.cables
    ]
    length, wrap, direction, middle, laid = (
        np.concatenate(part).real for part in zip(*parts, strict=True)
    )
    radius = np.array([pulley.radius for cable in robot.cables for pulley in cable.pulleys])
    ends = [node for cable in robot.cables for node in (cable.nodes[0], cable.nodes[-1])]
    arms = np.zeros((length.size, q.size))
    for j in range(q.size):
        moved = q.astype(complex)
        moved[j] += 1j * STEP
        arms[:, j] = np.concatenate([_frozen(robot, cable, q, moved) for cable in robot.cables])
    return Geometry(
        length, arms, wrap, direction, radius * wrap, middle,
        np.array([end.radius for end in ends]), laid,
    )  # fmt: skip


def moved_middle(robot: Robot, before: Geometry, now: Geometry) -> Vector:
    """Motion of the middle of every arc on its body between two poses [m], the nearest one."""
    radius = np.array([pulley.radius for cable in robot.cables for pulley in cable.pulleys])
    spatial = np.array(
        [cable.placed and not robot.planar for cable in robot.cables for _ in cable.pulleys]
    )
    way = now.middle - before.middle
    turn = 2 * np.pi * np.where(radius > 0.0, radius, 1.0)
    whole = np.where(spatial, 0.0, np.floor(way / turn + 0.5))  # in space, turns are counted
    return np.asarray(way - whole * turn)


def _frozen(robot: Robot, cable: Cable, q: Vector, moved: Complex) -> Vector:
    """Derivative of the free lengths between points of contact that rest in their bodies [m].

    Args:
        robot, cable: the description.
        q: joint angles.
        moved: the same with an imaginary step of one of them.
    """
    if not cable.placed:
        return _tabled_span(robot, cable, moved).imag / STEP
    _, angle, _ = _tangents(robot, cable, q.astype(complex))
    here, there = _frames(robot, q.astype(complex)), _frames(robot, moved)

    def seen(k: int, e: int) -> tuple[complex, complex]:
        """Where the step moves the point of node k at which the cable meets element e."""
        node = cable.nodes[k]
        reach = node.place.turn * node.radius  # the centre lies to the left of the cable
        x, y, turned = here[node.place.frame]
        right = np.sin(angle[e] - turned), -np.cos(angle[e] - turned)
        px, py = (
            node.place.position[0] + reach * right[0],
            node.place.position[1] + reach * right[1],
        )
        x, y, turned = there[node.place.frame]
        c, s = np.cos(turned), np.sin(turned)
        return x + c * px - s * py, y + s * px + c * py

    lengths = []
    for e in range(len(cable.nodes) - 1):
        (x1, y1), (x2, y2) = seen(e, e), seen(e + 1, e)
        lengths.append(np.sqrt((x2 - x1) ** 2 + (y2 - y1) ** 2))
    return np.array(lengths).imag / STEP


def _tabled_span(robot: Robot, cable: Cable, q: Complex) -> Complex:
    """Free lengths by tables if arcs did not grow: what is laid on comes off the moving end."""
    span, wrap = _tables_alone(robot, cable, q)
    for k, pulley in enumerate(cable.pulleys):
        arc = pulley.radius * wrap[k]
        share = {"before": 1.0, "both": 0.5, "after": 0.0}[pulley.moving_end]
        span[k] += share * arc
        span[k + 1] += (1.0 - share) * arc
    return span


def _tables(robot: Robot, cable: Cable, q: Complex) -> tuple[Complex, ...]:
    """Sums of functions of single joints, the arcs of (E6), and the middles of these arcs."""
    span, wrap = _tables_alone(robot, cable, q)
    middle = []
    for pulley, beta in zip(cable.pulleys, wrap, strict=True):
        # from the end that rests, half of the arc towards the one that moves
        way = {"before": -0.5, "both": 0.0, "after": 0.5}[pulley.moving_end]
        middle.append(way * pulley.radius * beta)
    direction = np.zeros((span.size, 3), complex)
    middles = np.array(middle, complex)
    return _with_arcs(cable, span, wrap), wrap, direction, middles, np.zeros(2, complex)


def _tables_alone(robot: Robot, cable: Cable, q: Complex) -> tuple[Complex, Complex]:
    """Sums of functions of single joints: free lengths and wraps."""
    joints = {joint.name: k for k, joint in enumerate(robot.joints)}

    def total(profiles: tuple[Profile, ...]) -> complex:
        return sum((tabled(p, q[joints[p.joint]] if p.joint else 0j) for p in profiles), 0j)

    span = np.array([total(span) for span in cable.spans])
    wrap = np.array([total(pulley.wrap) for pulley in cable.pulleys], complex)
    return span, wrap


def tabled(profile: Profile, q: complex) -> complex:
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


def _with_arcs(cable: Cable, span: Complex, wrap: Complex) -> Complex:
    """(E6): half of a pulley's arc belongs to each element beside it."""
    half = 0.5 * np.array([pulley.radius for pulley in cable.pulleys]) * wrap
    length = span.copy()
    length[:-1] += half
    length[1:] += half
    return length


def _positions(robot: Robot, cable: Cable, q: Complex) -> tuple[Complex, ...]:
    """(E4) to (E6) for a path of directed circles, and the middles of its arcs."""
    reference = np.array([joint.reference_angle for joint in robot.joints], complex)
    _, angle_0, turned_0 = _tangents(robot, cable, reference)
    span, angle, turned = _tangents(robot, cable, q)
    turn = np.array([node.place.turn for node in cable.nodes])
    reach = turn * np.array([node.radius for node in cable.nodes])
    middle = np.mod((turn[1:-1] * np.diff(angle_0)).real, 2 * np.pi)
    wrap = middle + _principal(turn[1:-1] * np.diff(angle) - middle)  # (E5)
    length = _with_arcs(cable, span, wrap)
    # an end with a radius: the whole arc, less the turn of its frame
    first = _principal(angle[0] - angle_0[0]) - turned[0] + turned_0[0]
    last = _principal(angle[-1] - angle_0[-1]) - turned[-1] + turned_0[-1]
    laid = np.array([reach[0] * first, -reach[-1] * last])
    length[0] += laid[0]
    length[-1] += laid[1]
    direction = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    # polar angle of the middle as the body sees it; the cable passes it in the sense of its turn
    enters = angle[:-1] - 0.5 * np.pi * turn[1:-1]
    polar = enters + 0.5 * turn[1:-1] * wrap - turned[1:-1]
    return length, wrap, direction, reach[1:-1] * polar, laid


def _tangents(robot: Robot, cable: Cable, q: Complex) -> tuple[Complex, Complex, Complex]:
    """(E4): spans and directions of all elements, and the turns of the nodes' frames."""
    pose = _frames(robot, q)
    centre, turned = [], []
    for node in cable.nodes:
        x, y, angle = pose[node.place.frame]
        c, s = np.cos(angle), np.sin(angle)
        centre.append((x + c * node.place.position[0] - s * node.place.position[1],
                       y + s * node.place.position[0] + c * node.place.position[1]))  # fmt: skip
        turned.append(angle)
    (dx, dy) = np.diff(np.array(centre), axis=0).T
    h = np.diff([node.place.turn * node.radius for node in cable.nodes])
    span = np.sqrt(dx * dx + dy * dy - h * h)
    return span, _angle(dx, dy) - _angle(span, h + 0j), np.array(turned)


def _frames(robot: Robot, q: Complex) -> dict[str, tuple[complex, complex, complex]]:
    """Origin and orientation of every frame in the base; parents come first."""
    joints = {joint.name: k for k, joint in enumerate(robot.joints)}
    pose: dict[str, tuple[complex, complex, complex]] = {}
    for frame in robot.frames:
        px, py, pa = pose[frame.parent] if frame.parent else (0j, 0j, 0j)
        x, y, turn = _motion(frame, q[joints[frame.joint]] if frame.joint else 0j)
        c, s = frame.rotation[0], frame.rotation[3]
        x, y = frame.origin[0] + c * x - s * y, frame.origin[1] + s * x + c * y
        angle = np.arctan2(s, c)
        c, s = np.cos(pa), np.sin(pa)
        pose[frame.name] = px + c * x - s * y, py + s * x + c * y, pa + angle + turn
    return pose


def _motion(frame: Frame, q: complex) -> tuple[complex, complex, complex]:
    """Displacement in the frame at rest, and turn; two equal circles roll on each other."""
    if frame.motion == "revolute":
        return 0j, 0j, q
    if frame.motion == "prismatic":
        return q * frame.axis[0], q * frame.axis[1], 0j
    if frame.motion == "rolling":
        reach = 2 * frame.rolling_radius
        return reach * np.cos(q), reach * np.sin(q), 2 * q
    return 0j, 0j, 0j


def _angle(x: Complex, y: Complex) -> Complex:
    """atan2(y, x) with its derivative in the imaginary part."""
    change = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
    return np.asarray(np.arctan2(y.real, x.real) + 1j * change)


def _principal(angle: Complex) -> Complex:
    """The same angle in [-pi, pi)."""
    return np.asarray(angle - 2 * np.pi * np.floor((angle.real + np.pi) / (2 * np.pi)))
