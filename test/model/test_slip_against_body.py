"""Cable that is laid onto a body and taken off it does not slide, and nothing changes.

The end of the cable moves on the involute of a fixed body: the free length shrinks by what is laid
on.  No motor turns, so that every piece of cable keeps its tension to the tolerance of the solver.
In the plane the end is a point of a carriage with two axes; in space the same carriage stands in a
frame that is tilted, so that nothing lies along an axis of the base.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, pi

import numpy as np
import pytest
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.model.state import OK, state_views
from cdrj_ros.robot.description import Node, Pulley, Robot
from cdrj_ros.robot.reader import parse_robot

Vector = NDArray[np.float64]

RADIUS, BEFORE, BEHIND, PRELOAD = 0.02, 0.15, 0.12, 50.0
UNCHANGED = 1e-9
"""Of the tension.  The solver stops at 1e-8 N, which is 2e-10 of it."""

TILT = "rpy: [0.5, -0.4, 0.7], origin: [0.03, -0.02, 0.05]"


@dataclass(frozen=True)
class Play:
    """A motion as it was estimated, one row per sample."""

    tension: Vector
    """[N]."""
    bristle: Vector
    """Of every contact [N]."""
    slip: Vector
    """Of every pulley in every sample [m]."""
    wrap: Vector
    """[rad]."""
    track: Vector
    """[m]."""
    effort: Vector
    """[N] or [N m]."""


def play(model: Model, motor: Vector, joint: Vector) -> Play:
    """Step through a motion; every sample is solved and has the status OK.

    Args:
        model: the robot.
        motor, joint: [rad] or [m], shapes (n, motors) and (n, joints).
    """
    state = initial_state(model)
    rows: list[tuple[Vector, ...]] = []
    for k, (m, q) in enumerate(zip(motor, joint, strict=True)):
        state, estimate = step(model, state, Sample((k + 1) * 1_000_000, m.copy(), q.copy()))
        assert np.all(estimate.status == OK), k
        views = state_views(model.sizes, state.values)
        rows.append(
            (estimate.tension.copy(), views.bristle.copy(), 1e-3 * estimate.slip_speed,
             shape_at(model, q).wrap, views.track.copy(), estimate.joint_effort.copy())
        )  # fmt: skip
    return Play(*(np.array(column) for column in zip(*rows, strict=True)))


def cable(*nodes: str, friction: str = "mu_c: 0.2", head: str = "") -> Robot:
    """A robot of one cable with a carriage of three axes x, y, z."""
    lines = "".join(f"      - {{{node}}}\n" for node in nodes)
    return parse_robot(
        f"name: involute\nmotors: [{{name: m}}]\n{head}"
        f"friction: {{law: elastoplastic, {friction}}}\n"
        "cables:\n  - name: c\n    axial_stiffness: 1e4\n"
        f"    preload: {PRELOAD}\n    nodes:\n{lines}"
    )


IN_SPACE = f"""
joints: [{{name: x, range: [-1, 1]}}, {{name: y, range: [-1, 1]}}, {{name: z, range: [-1, 1]}}]
frames:
  - {{name: table, motion: fixed, {TILT}}}
  - {{name: rail, parent: table, motion: prismatic, joint: x, axis: [1, 0, 0]}}
  - {{name: post, parent: rail, motion: prismatic, joint: y, axis: [0, 1, 0]}}
  - {{name: hand, parent: post, motion: prismatic, joint: z, axis: [0, 0, 1]}}
"""
START = pi / 3
"""Wrap in the reference pose [rad]."""


def involute(turned: Vector, sense: float = 1.0, slope: float = 0.0) -> Vector:
    """Place of the end after more cable is laid on, by angles [rad]; shape (n, 3).

    The cable comes along x, below the body for the sense 1, and leaves it after ``START``.  With a
    slope it is a helix, straight on the unrolled cylinder.
    """
    angle = START + turned
    level = BEHIND - RADIUS * turned
    x = RADIUS * np.sin(angle) + level * np.cos(angle)
    y = sense * (-RADIUS * np.cos(angle) + level * np.sin(angle))
    rise = slope * (BEFORE + RADIUS * START + BEHIND)
    return np.stack([x, y, np.full(angle.shape, rise)], axis=1)


def to_and_fro(most: float, least: float, samples: int = 300) -> Vector:
    """An angle that grows from 0 to ``most``, falls to ``least`` and returns [rad]."""
    ways = [np.linspace(a, b, samples) for a, b in ((0.0, most), (most, least), (least, 0.0))]
    return np.concatenate(ways)


def joints_of(robot: Robot, place: Vector, rest: Vector) -> Vector:
    """Joint angles that move the end from its place in the reference pose."""
    return np.asarray((place - rest)[:, : len(robot.joints)])


def at(frame: str, x: float, y: float, z: float | None = None, kind: str = "anchor") -> str:
    """An end or an eyelet at a place."""
    numbers = [float(v) for v in ((x, y) if z is None else (x, y, z))]
    frame = "" if frame == "base" else f", frame: {frame}"
    return f"type: {kind}, position: {numbers}{frame}"


def assert_nothing_happens(found: Play, least: float = 1.0) -> None:
    """All tensions and bristles as at first, no slip, while at least so much was laid on [rad]."""
    np.testing.assert_allclose(found.tension / found.tension[0], 1.0, rtol=0, atol=UNCHANGED)
    assert np.abs(found.bristle - found.bristle[0]).max() < UNCHANGED * PRELOAD
    touching = found.wrap[1:] * found.wrap[:-1] > 0.0
    assert np.abs(found.slip[1:])[touching].max() < UNCHANGED * RADIUS
    assert np.ptp(found.wrap, axis=0).max() > least


def with_cells(robot: Robot, cells: int) -> Robot:
    def changed(node: Node) -> Node:
        return replace(node, cells=cells) if isinstance(node, Pulley) else node

    (only,) = robot.cables
    return replace(robot, cables=(replace(only, nodes=tuple(map(changed, only.nodes))),))


SPACE = {
    "great circle of a sphere": (
        ("type: sphere, radius: 0.02, position: [0, 0, 0], frame: table, "
        "side: [0.025, -0.04, 0]"),
        0.0,
    ),
    "circle of a cylinder": (
        ("type: cylinder, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], frame: table, "
        "turn: ccw"), 0.0,
    ),
    "helix of a cylinder": (
        ("type: cylinder, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], frame: table, "
        "turn: ccw"), 0.4,
    ),
    "helix of three turns": (
        ("type: cylinder, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], frame: table, "
        "turn: ccw, turns: 2"), 0.1,
    ),
    "groove of a pulley": (
        ("type: pulley, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], frame: table, "
        "turn: ccw"), 0.0,
    ),
    "swivelling pulley": (
        f"type: swivel, radius: 0.02, position: [0, {-RADIUS}, 0], axis: [1, 0, 0], frame: table",
        0.0,
    ),
}  # fmt: skip


def in_space(which: str) -> tuple[Robot, float, Vector]:
    """A robot, the slope of its cable and the place of its end in the reference pose."""
    body, slope = SPACE[which]
    if "turns: 2" in body:  # two more turns are wound on before
        slope *= (BEFORE + RADIUS * START + BEHIND) / (BEFORE + RADIUS * (START + 4 * pi) + BEHIND)
    rest = involute(np.zeros(1), 1.0, SPACE[which][1])[0]
    robot = cable(at("table", -BEFORE, -RADIUS, 0.0), body, at("hand", *rest), head=IN_SPACE)
    return robot, slope, rest


@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("which", SPACE)
def test_laying_on_in_space_does_not_slide(which: str, cells: int) -> None:
    robot, slope, rest = in_space(which)
    model = prepare(with_cells(robot, cells), check_range=False)
    turned = to_and_fro(1.2, -0.6)
    joint = joints_of(robot, involute(turned, 1.0, SPACE[which][1]), rest)
    found = play(model, np.zeros((len(joint), 1)), joint)
    assert_nothing_happens(found)
    moved = np.ptp(found.track[:, 0])
    assert moved == pytest.approx(0.5 * RADIUS * 1.8 * hypot(1.0, slope), rel=1e-9)


CARRIED = {
    "plane": (
        ("joints: [{name: q, range: [-3, 3]}, {name: p, range: [-1, 1]}]\nframes:\n"
        "  - {name: slide, motion: prismatic, joint: p, direction: [1, 2]}\n"
        "  - {name: all, parent: slide, motion: revolute, joint: q, origin: [0.1, 0.2]}\n"),
        ("type: winch, motor: m, winding: 1, radius: 0.015, position: [-0.1, 0], frame: all, "
         "turn: ccw"),
        ("type: pulley, radius: 0.02, position: [0, 0], turn: ccw, frame: all",
         "type: pulley, radius: 0.015, position: [0.05, 0.1], turn: cw, frame: all"),
        "type: anchor, position: [0.2, 0.05], frame: all",
    ),
    "space": (
        ("joints: [{name: q, range: [-3, 3]}, {name: p, range: [-1, 1]}]\nframes:\n"
        "  - {name: slide, motion: prismatic, joint: p, axis: [1, 2, -1], rpy: [0.3, 0.2, 0.1]}\n"
        "  - {name: all, parent: slide, motion: revolute, joint: q, origin: [0.1, 0.2, 0.3], "
        "axis: [0.3, -0.5, 1]}\n"),
        ("type: winch, motor: m, winding: 1, radius: 0.015, position: [-0.1, 0, 0], frame: all, "
         "axis: [0, 0, 1], turn: ccw"),
        (("type: cylinder, radius: 0.02, position: [0, 0, 0], turn: ccw, axis: [0.1, 0, 1], "
         "frame: all"),
         "type: sphere, radius: 0.03, position: [0.1, 0.03, 0.05], frame: all",
         "type: swivel, radius: 0.015, position: [0.15, 0.1, 0.1], axis: [1, 1, 0], frame: all"),
        "type: anchor, position: [0.2, 0.05, 0.02], frame: all",
    ),
}  # fmt: skip


@pytest.mark.parametrize("where", CARRIED)
def test_a_body_that_carries_everything_along_changes_nothing(where: str) -> None:
    head, first, guides, last = CARRIED[where]
    model = prepare(cable(first, *guides, last, head=head), check_range=False)
    wound = np.concatenate([np.linspace(0.0, 0.06, 100), np.linspace(0.06, 0.05, 20)])
    held = np.full(500, wound[-1])
    motor = np.concatenate([wound, held])[:, None]
    phase = np.linspace(0.0, 9.0, 500)
    moved = np.stack([2.0 * np.sin(phase), 0.5 * np.sin(0.7 * phase)], axis=1)
    joint = np.concatenate([np.zeros((120, 2)), moved])
    found = play(model, motor, joint)
    resting = play(model, motor, np.zeros_like(joint))
    assert np.ptp(found.tension[120]) > 5.0, "it has slid"
    most = UNCHANGED * PRELOAD
    np.testing.assert_allclose(found.tension, resting.tension, rtol=0, atol=most)
    np.testing.assert_allclose(found.bristle, resting.bristle, rtol=0, atol=most)
    assert np.abs(found.effort).max() < 1e-9 * PRELOAD
