"""Cable that is laid onto a body and taken off it does not slide, and nothing changes.

The end of the cable moves on the involute of a fixed body: the free length shrinks by what is laid
on.  No motor turns, so that every piece of cable keeps its tension to the tolerance of the solver.
In the plane the end is a point of a carriage with two axes; in space the same carriage stands in a
frame that is tilted, so that nothing lies along an axis of the base.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, hypot, log, pi, sin

import numpy as np
import pytest
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.model.state import state_views
from cdrj_ros.model.status import OK
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


IN_PLANE = """
joints: [{name: x, range: [-1, 1]}, {name: y, range: [-1, 1]}]
frames:
  - {name: rail, motion: prismatic, joint: x, direction: [1, 0]}
  - {name: hand, parent: rail, motion: prismatic, joint: y, direction: [0, 1]}
"""
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


PLANE_NODES = {
    "ccw": (1.0, "type: pulley, radius: 0.02, position: [0, 0], turn: ccw"),
    "cw": (-1.0, "type: pulley, radius: 0.02, position: [0, 0], turn: cw"),
}


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


@pytest.mark.parametrize("cells", [1, 5])
@pytest.mark.parametrize("which", PLANE_NODES)
@pytest.mark.parametrize("first", [False, True], ids=["last end", "first end"])
def test_laying_on_in_the_plane_does_not_slide(first: bool, which: str, cells: int) -> None:
    sense, pulley = PLANE_NODES[which]
    rest = involute(np.zeros(1), sense)[0]
    still = at("base", -BEFORE, -sense * RADIUS)
    moving = at("hand", rest[0], rest[1])
    if first:  # backwards the cable goes round in the other sense
        turn = {"ccw": "cw", "cw": "ccw"}[which]
        nodes = (moving, pulley.replace(f"turn: {which}", f"turn: {turn}"), still)
    else:
        nodes = (still, pulley, moving)
    robot = with_cells(cable(*nodes, head=IN_PLANE), cells)
    joint = joints_of(robot, involute(to_and_fro(1.2, -0.6), sense), rest)
    found = play(prepare(robot, check_range=False), np.zeros((len(joint), 1)), joint)
    assert_nothing_happens(found)
    # the middle moves by half of what is laid on, towards the end that moves
    moved = np.ptp(found.track[:, 0])
    assert moved == pytest.approx(0.5 * RADIUS * 1.8, rel=1e-9)
    assert (found.track[299, 0] < found.track[0, 0]) == first


def with_cells(robot: Robot, cells: int) -> Robot:
    def changed(node: Node) -> Node:
        return replace(node, cells=cells) if isinstance(node, Pulley) else node

    (only,) = robot.cables
    return replace(robot, cables=(replace(only, nodes=tuple(map(changed, only.nodes))),))


@pytest.mark.parametrize("cells", [1, 4])
def test_laying_on_by_tables_does_not_slide_at_the_end_that_moves(cells: int) -> None:
    robot = with_cells(
        parse_robot(f"""
        name: tables
        motors: [{{name: m}}]
        joints: [{{name: q, range: [-1, 2]}}]
        friction: {{law: elastoplastic, mu_c: 0.2}}
        cables:
          - name: c
            axial_stiffness: 1e4
            preload: {PRELOAD}
            nodes:
              - {{type: winch, motor: m, winding: 1, radius: 0.02}}
              - {{type: pulley, radius: {RADIUS}, wrap_angle: {{joint: q, offset: 1.2, slope: 1}}}}
              - {{type: anchor}}
            spans: [{BEFORE}, {{joint: q, offset: {BEHIND}, slope: {-RADIUS}}}]
        """),
        cells,
    )

    def moving(end: str) -> Robot:
        def changed(node: Node) -> Node:
            return replace(node, moving_end=end) if isinstance(node, Pulley) else node

        (only,) = robot.cables
        return replace(robot, cables=(replace(only, nodes=tuple(map(changed, only.nodes))),))

    joint = to_and_fro(1.2, -0.6)[:, None]
    motor = np.zeros_like(joint)
    found = play(prepare(moving("after")), motor, joint)
    assert_nothing_happens(found)
    for end in ("both", "before"):  # then the same lengths mean that the cable slides
        other = play(prepare(moving(end)), motor, joint)
        assert np.ptp(other.tension, axis=0).max() > 0.1 * PRELOAD


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


def test_a_lever_about_the_axis_lays_a_helix_on_as_a_slide_follows() -> None:
    """The slide lies along the level tangent and takes back what the lever lays on: s = -r q."""
    slope, along = 0.4, (cos(START), sin(START), 0.0)
    rest = involute(np.zeros(1), 1.0, slope)[0]
    head = f"""
joints: [{{name: q, range: [-3, 3]}}, {{name: s, range: [-1, 1]}}]
frames:
  - {{name: table, motion: fixed, {TILT}}}
  - {{name: lever, parent: table, motion: revolute, joint: q, axis: [0, 0, 1]}}
  - {{name: hand, parent: lever, motion: prismatic, joint: s, axis: {list(along)}}}
"""
    body, _ = SPACE["helix of a cylinder"]
    robot = cable(at("table", -BEFORE, -RADIUS, 0.0), body, at("hand", *rest), head=head)
    turned = to_and_fro(1.2, -0.6)
    joint = np.stack([turned, -RADIUS * turned], axis=1)
    found = play(prepare(robot, check_range=False), np.zeros((turned.size, 1)), joint)
    assert_nothing_happens(found)


@pytest.mark.parametrize("which", PLANE_NODES)
def test_laying_on_keeps_what_friction_holds(which: str) -> None:
    """With unequal tensions before and behind, too, but for the arc's lump.

    The model divides the arc in its middle, so that what passes there is stretched by the mean of
    both tensions, not by one of them: an element of the length l changes its tension by no more
    than half of their difference times m / l, where m is the way of the middle.
    """
    sense, pulley = PLANE_NODES[which]
    rest = involute(np.zeros(1), sense)[0]
    start = (
        f"type: winch, motor: m, winding: 1, radius: 0.01, "
        f"position: [{-BEFORE}, {-sense * (RADIUS - 0.01)}], turn: {which}"
    )
    robot = cable(start, pulley, at("hand", *rest[:2]), friction="mu_c: 0.4", head=IN_PLANE)
    turned = to_and_fro(1.2, -0.2)
    pulled = np.concatenate([np.linspace(0.0, 0.1, 150), np.linspace(0.1, 0.07, 50)])
    motor = np.concatenate([pulled, np.full(turned.size, 0.07)])[:, None]
    joint = np.concatenate([np.zeros((200, 2)), joints_of(robot, involute(turned, sense), rest)])
    found = play(prepare(robot, check_range=False), motor, joint)
    held = found.tension[200:]
    difference = held[0, 0] - held[0, 1]
    assert difference > 15.0
    way, shortest = np.abs(found.track[200:, 0] - found.track[200, 0]), BEHIND - 0.7 * RADIUS
    allowed = 0.5 * difference * way / shortest
    # the stretch is that at the sample before: the way back does not take all of it back
    rest_of_it = 5e-5 * difference
    assert np.all(np.abs(held - held[0]).max(axis=1) <= allowed + rest_of_it)
    assert allowed.max() < 0.06 * difference


def test_a_swivelling_pulley_takes_its_cable_along() -> None:
    """The end goes round the axis along which the cable comes, and lays cable on meanwhile."""
    robot, _, rest = in_space("swivelling pulley")
    model = prepare(robot, check_range=False)
    turned = to_and_fro(1.2, -0.6)
    place = involute(turned)
    azimuth = 0.8 * np.sin(np.linspace(0.0, 7.0, turned.size))
    away = place[:, 1] + RADIUS  # from the axis, which the cable comes along
    place[:, 1] = away * np.cos(azimuth) - RADIUS
    place[:, 2] = away * np.sin(azimuth)
    found = play(model, np.zeros((turned.size, 1)), joints_of(robot, place, rest))
    assert_nothing_happens(found)


@pytest.mark.parametrize("which", ["great circle of a sphere", "circle of a cylinder"])
def test_lifting_off_and_coming_back_does_not_slide(which: str) -> None:
    """In the air the end stays at one distance from the first; the cable is as long as before.

    In the sample in which it touches again the contact is given no friction yet, and the way of the
    middle within that sample is not known; tensions are equal then, so that nothing is lost.
    """
    robot, _, rest = in_space(which)
    model = prepare(robot, check_range=False)
    turned = to_and_fro(0.6, -START - 0.4, 400)
    place = involute(np.maximum(turned, -START))
    start, straight = np.array([-BEFORE, -RADIUS, 0.0]), BEFORE + BEHIND + RADIUS * START
    off = turned < -START
    down = turned[off] + START
    place[off] = start + straight * np.stack([np.cos(down), np.sin(down), 0.0 * down], axis=1)
    found = play(model, np.zeros((turned.size, 1)), joints_of(robot, place, rest))
    assert 100 < off.sum() < turned.size - 400
    assert np.all(found.wrap[off, 0] == 0.0)
    assert np.all(found.wrap[~off, 0][1:-1] >= 0.0)
    assert_nothing_happens(found)


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


def some_motion(robot: Robot, samples: int = 400) -> tuple[Vector, Vector]:
    """Motors and joints that let the cable slide to and fro."""
    phase = np.linspace(0.0, 8.0, samples)
    waves = [4e-4 * np.sin((1.0 + 0.3 * k) * phase) for k in range(len(robot.joints))]
    return 0.03 * np.sin(1.7 * phase)[:, None], np.stack(waves, axis=1)


GENERAL = (
    "type: winch, motor: m, winding: 1, radius: 0.015, position: [-0.15, {s}0.01], turn: {a}",
    "type: pulley, radius: 0.02, position: [0, 0], turn: {a}",
    "type: pulley, radius: 0.015, position: [0.05, {s}0.1], turn: {b}, frame: rail",
    "type: anchor, position: [0.2, {s}0.06], frame: hand",
)
MIRRORED_RAIL = IN_PLANE.replace("direction: [0, 1]", "direction: [0, -1]")


def test_a_mirrored_robot_has_the_same_tensions_and_efforts() -> None:
    one = cable(*(node.format(s="", a="ccw", b="cw") for node in GENERAL), head=IN_PLANE)
    other = cable(*(node.format(s="-", a="cw", b="ccw") for node in GENERAL), head=MIRRORED_RAIL)
    found, image = (play(prepare(robot, check_range=False), *some_motion(robot))
                    for robot in (one, other))  # fmt: skip
    assert np.ptp(found.tension, axis=1).max() > 5.0
    for name in ("tension", "bristle", "wrap", "track", "effort"):
        mine, theirs = getattr(found, name), getattr(image, name)
        np.testing.assert_allclose(mine - mine[0], theirs - theirs[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("which", SPACE)
def test_a_robot_that_is_moved_turned_or_mirrored_has_the_same_tensions(which: str) -> None:
    """All frames stand on the table: its place does not count, nor do mirrored axes."""
    robot, _, _ = in_space(which)
    moved = parse_table(robot, which, "rpy: [-1.1, 0.3, 2.0], origin: [0.4, 0.1, -0.3]")
    results = []
    for one in (robot, moved):
        motor, joint = some_motion(one)
        results.append(play(prepare(one, check_range=False), 0.0 * motor, joint))
    found, other = results
    assert np.ptp(found.tension, axis=1).max() > 0.5
    for name in ("tension", "bristle", "wrap", "effort"):
        np.testing.assert_allclose(getattr(found, name), getattr(other, name), rtol=0, atol=2e-8)


def parse_table(robot: Robot, which: str, table: str) -> Robot:
    """The robot of ``in_space`` on another table."""
    rest = involute(np.zeros(1), 1.0, SPACE[which][1])[0]
    nodes = at("table", -BEFORE, -RADIUS, 0.0), SPACE[which][0], at("hand", *rest)
    assert robot.frames
    return cable(*nodes, head=IN_SPACE.replace(TILT, table))


def test_lengths_and_arms_do_not_depend_on_the_number_of_cells() -> None:
    for which in SPACE:
        robot, _, _ = in_space(which)
        whole, fine = prepare(robot, check_range=False), prepare(with_cells(robot, 7),
                                                                 check_range=False)  # fmt: skip
        for angle in np.random.default_rng(4).uniform(-0.02, 0.02, (10, 3)):
            one, other = shape_at(whole, angle), shape_at(fine, angle)
            np.testing.assert_array_equal(other.length, one.length)
            np.testing.assert_array_equal(other.lever_arm, one.lever_arm)
            assert other.segment.size == one.length.size + 6
            assert other.segment.sum() == pytest.approx(one.length.sum(), rel=1e-14)


def grooved(mu: float, cells: int) -> Robot:
    """Half a turn of cable between a winch and an anchor."""
    robot = cable(
        "type: winch, motor: m, winding: 1, radius: 0.015, position: [-0.1, 0.0], turn: cw",
        "type: pulley, radius: 0.02, position: [0.1, 0.0], turn: cw",
        "type: anchor, position: [-0.1, -0.02]",
        friction=f"mu_c: {mu}, bristle_stiffness: 1e9", head="joints: []\n",
    )  # fmt: skip
    return with_cells(robot, cells)


def wound(robot: Robot, motor: Vector) -> tuple[Vector, Vector, Vector]:
    """Tensions, at the last sample those of all segments [N], and the wrap [rad]."""
    model = prepare(robot)
    found = play(model, motor[:, None], np.empty((motor.size, 0)))
    state = initial_state(model)
    for k, angle in enumerate(motor):
        sample = Sample((k + 1) * 1_000_000, np.array([angle]), np.empty(0))
        state, _ = step(model, state, sample)
    views = state_views(model.sizes, state.values)
    return found.tension, 1e4 * (views.length / views.material - 1.0), found.wrap[-1]


@pytest.mark.parametrize("cells", [2, 30])
def test_cells_that_all_slide_have_the_tensions_of_the_whole_pulley(cells: int) -> None:
    motor = np.concatenate([np.linspace(0.0, 0.2, 300), np.linspace(0.2, -0.02, 300)])
    whole, _, wrap = wound(grooved(0.2, 1), motor)
    fine, _, _ = wound(grooved(0.2, cells), motor)
    for k, way in ((299, 1.0), (-1, -1.0)):
        ratio = np.exp(way * 0.2 * wrap[0])
        assert whole[k, 0] / whole[k, 1] == pytest.approx(ratio, rel=1e-6)
        assert fine[k, 0] / fine[k, 1] == pytest.approx(ratio, rel=1e-6)
    # the cable on the pulley is stretched by another mean tension
    np.testing.assert_allclose(fine[[299, -1]], whole[[299, -1]], rtol=5e-3)


def test_grashofs_sliding_arc_forms_from_the_cells() -> None:
    """From the pulling end the cable slides over the arc that halves its excess of tension."""
    cells, mu = 60, 0.2
    tension, inside, wrap = wound(grooved(mu, cells), np.linspace(0.0, 0.02, 600))
    ratio = tension[-1, 0] / tension[-1, 1]
    assert 1.05 < ratio < np.exp(mu * wrap[0]) / 1.2
    falls = np.diff(inside)
    slides = falls < -0.99 * (1.0 - np.exp(-mu * wrap[0] / cells)) * inside[:-1]
    count = int(slides.sum())
    assert np.all(slides[:count]), "one arc, from the pulling end on"
    assert count * wrap[0] / cells == pytest.approx(log(ratio) / mu, abs=1.5 * wrap[0] / cells)
    np.testing.assert_allclose(inside[count + 2 :], PRELOAD, rtol=2e-3)
