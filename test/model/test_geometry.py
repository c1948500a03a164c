"""Lengths, wraps and lever arms against cases computed by hand and against differences."""

from __future__ import annotations

from dataclasses import replace
from math import asin, atan2, cos, pi, radians, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model.element_law import law_and_measured
from scipy.interpolate import PchipInterpolator

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.prepared import Model, Shape, prepare, shape_at
from cdrj_ros.robot.description import MovingEnd, Node, Pulley, Robot
from cdrj_ros.robot.reader import load_robot, parse_robot

ROBOTS = Path(__file__).parents[2] / "config" / "robots"

Circle = tuple[float, float, float]

HEAD = """
name: hand
motors: [{name: m}]
joints: [%s]
frames: [%s]
cables:
  - name: c
    axial_stiffness: 1000
    preload: 1
    nodes:
"""


def routed(nodes: str, joints: str = "", frames: str = "") -> Model:
    """A robot of one cable whose nodes are written one per line."""
    lines = [f"      - {line.strip()}" for line in nodes.strip().splitlines()]
    return prepare(parse_robot(HEAD % (joints, frames) + "\n".join(lines) + "\n"))


def still(nodes: str) -> Shape:
    return shape_at(routed(nodes), np.zeros(0))


def tangent(one: Circle, other: Circle) -> tuple[float, float]:
    """Length and direction of a cable from one sector to another, in the reference pose.

    A circle has its centre and its radius [m], negative where the cable goes round clockwise.
    """
    sectors = []
    for x, y, radius in (map(float, one), map(float, other)):
        turn = "ccw" if radius > 0 else "cw"
        sectors.append(
            f"{{type: anchor, position: [{x}, {y}], radius: {abs(radius)}, turn: {turn}}}"
        )
    shape = still("\n".join(sectors))
    return shape.length[0], atan2(shape.direction[0, 1], shape.direction[0, 0])


def test_open_tangent_of_equal_circles_is_as_long_as_their_distance() -> None:
    length, angle = tangent((0.0, 0.0, 0.5), (3.0, 4.0, 0.5))
    assert (length, angle) == pytest.approx((5.0, atan2(4, 3)))


def test_open_tangent_of_unequal_circles() -> None:
    # both go counter-clockwise, so the line runs below them and falls towards the larger one
    length, angle = tangent((0.0, 0.0, 1.0), (5.0, 0.0, 2.0))
    assert length == pytest.approx(sqrt(24.0))
    assert angle == pytest.approx(-asin(1 / 5))


def test_crossed_tangent() -> None:
    # from below the first circle (counter-clockwise) to above the second one (clockwise)
    length, angle = tangent((0.0, 0.0, 1.0), (5.0, 0.0, -2.0))
    assert length == pytest.approx(4.0)
    assert angle == pytest.approx(asin(3 / 5))


def test_a_tangent_touches_both_circles_at_right_angles() -> None:
    generator = np.random.default_rng(1)
    for _ in range(200):
        c1, c2 = generator.normal(size=2), generator.normal(size=2) + 6.0
        r1, r2 = generator.uniform(-1.5, 1.5, 2)
        length, angle = tangent((*c1, r1), (*c2, r2))
        along = np.array([cos(angle), sin(angle)])
        right = np.array([sin(angle), -cos(angle)])  # counter-clockwise: the centre is on the left
        np.testing.assert_allclose(c1 + r1 * right + length * along, c2 + r2 * right, atol=1e-12)


@pytest.mark.parametrize("radii", [(1.0, 4.0), (-2.0, 1.5), (1.0, 4.2), (3.0, -0.001)])
def test_circles_without_a_common_tangent_are_refused(radii: tuple[float, float]) -> None:
    with pytest.raises(RobotFileError, match="no common tangent"):
        tangent((0.0, 0.0, radii[0]), (3.0, 0.0, radii[1]))


def test_overlapping_circles_that_turn_alike_have_a_common_tangent() -> None:
    generator = np.random.default_rng(2)
    for _ in range(200):
        r1, r2 = generator.uniform(0.5, 1.5, 2)
        apart = abs(r2 - r1) + generator.uniform(0.01, 1.0) * (r1 + r2 - abs(r2 - r1))
        length, _ = tangent((0.0, 0.0, r1), (apart, 0.0, r2))
        assert length == pytest.approx(sqrt(apart**2 - (r2 - r1) ** 2), rel=1e-9)


@pytest.mark.parametrize(
    ("end", "wrap", "span"),
    [
        ("[1, 5]", pi / 2, 4.0),
        ("[-4, 2]", pi, 4.0),
        ("[-1, -3]", 3 * pi / 2, 4.0),
        ("[4, 0]", 0.0, 4.0),
    ],
    ids=["quarter", "half", "three-quarters", "touched"],
)
def test_wraps_of_a_quarter_a_half_and_three_quarters_of_a_turn(
    end: str, wrap: float, span: float
) -> None:
    shape = still(f"""
        {{type: anchor, position: [-4, 0]}}
        {{type: pulley, radius: 1, position: [0, 1], turn: ccw}}
        {{type: anchor, position: {end}}}
    """)
    assert shape.wrap == pytest.approx([wrap], abs=1e-9)
    # half of the arc belongs to either element
    assert shape.length == pytest.approx([4.0 + wrap / 2, span + wrap / 2])
    np.testing.assert_allclose(shape.direction[0], [1.0, 0.0, 0.0], atol=1e-12)


def test_a_belt_crossed_between_two_pulleys() -> None:
    shape = still("""
        {type: anchor, position: [-4, 0]}
        {type: pulley, radius: 1, position: [0, 1], turn: ccw}
        {type: pulley, radius: 1, position: [2, 5], turn: cw}
        {type: anchor, position: [6, 6]}
    """)
    assert shape.wrap == pytest.approx([pi / 2, pi / 2])
    assert shape.length == pytest.approx([4 + pi / 4, 4 + pi / 2, 4 + pi / 4])
    np.testing.assert_allclose(shape.direction, [[1, 0, 0], [0, 1, 0], [1, 0, 0]], atol=1e-12)


def test_an_open_belt_round_unequal_pulleys() -> None:
    shape = still("""
        {type: anchor, position: [6, 1]}
        {type: pulley, radius: 1, position: [0, 0], turn: ccw}
        {type: pulley, radius: 2, position: [5, 0], turn: ccw}
        {type: anchor, position: [0, 8]}
    """)
    between = asin(1 / 5)
    assert shape.wrap[0] == pytest.approx(pi - between)
    assert shape.length[0] == pytest.approx(6.0 + (pi - between) / 2)
    # from the larger pulley to a point 8 above and 5 behind its axis
    far = sqrt(5**2 + 8**2)
    leaving = atan2(8, -5) + asin(2 / far)
    assert shape.wrap[1] == pytest.approx(leaving + between)
    assert shape.length[2] == pytest.approx(sqrt(far**2 - 4) + (leaving + between))
    assert shape.length[1] == pytest.approx(sqrt(24) + (pi - between) / 2 + leaving + between)


def test_a_mirrored_cable_has_the_same_lengths_and_wraps() -> None:
    text = """
        {{type: winch, motor: m, winding: 1, radius: 0.5, position: [-3, {s}1], turn: {a}}}
        {{type: pulley, radius: 1, position: [0, {s}1.5], turn: {a}}}
        {{type: pulley, radius: 0.3, position: [2, {s}5], turn: {b}}}
        {{type: anchor, position: [6, {s}6.5]}}
    """
    one = still(text.format(s="", a="ccw", b="cw"))
    other = still(text.format(s="-", a="cw", b="ccw"))
    np.testing.assert_allclose(one.wrap, other.wrap, atol=1e-12)
    np.testing.assert_allclose(one.length, other.length, atol=1e-12)
    np.testing.assert_allclose(one.direction * [1, -1, 1], other.direction, atol=1e-12)


def test_a_sector_on_the_axis_winds_its_radius_times_the_angle() -> None:
    for turn, sign in (("ccw", 1.0), ("cw", -1.0)):
        model = routed(
            f"""
            {{type: anchor, position: [-4, 0]}}
            {{type: anchor, radius: 0.5, frame: arm, position: [0, 0], turn: {turn}}}
            """,
            "{name: q, range: [-3, 3]}",
            "{name: arm, motion: revolute, joint: q}",
        )
        for q in (-3.0, -0.7, 0.0, 1.0, 3.0):
            shape = shape_at(model, np.array([q]))
            assert shape.length == pytest.approx([sqrt(16 - 0.25) + sign * 0.5 * q])
            assert shape.lever_arm == pytest.approx(np.array([[sign * 0.5]]))


def test_a_drum_on_a_turning_frame_pays_out_as_it_follows_the_cable() -> None:
    model = routed(
        """
        {type: winch, motor: m, winding: 1, radius: 0.5, frame: arm, position: [0, 0], turn: ccw}
        {type: anchor, position: [4, 0]}
        """,
        "{name: q, range: [-3, 3]}",
        "{name: arm, motion: revolute, joint: q}",
    )
    for q in (-2.0, 0.3, 2.5):
        assert shape_at(model, np.array([q])).length == pytest.approx([sqrt(15.75) - 0.5 * q])


def test_an_end_point_on_a_revolute_frame() -> None:
    model = routed(
        "{type: anchor, position: [-3, 0]}\n{type: anchor, frame: arm, position: [1, 0]}",
        "{name: q, range_deg: [-100, 100]}",
        "{name: arm, motion: revolute, joint: q, angle_deg: 90}",
    )
    for q in (-1.5, 0.0, 0.4, 1.7):  # law of cosines
        wanted = sqrt(10 + 6 * cos(q + pi / 2))
        assert shape_at(model, np.array([q])).length == pytest.approx([wanted])


def test_a_prismatic_frame_moves_along_its_direction() -> None:
    model = routed(
        "{type: anchor, position: [0, 0]}\n{type: anchor, frame: slide, position: [1, 0]}",
        "{name: q, range: [0, 2]}",
        "{name: slide, motion: prismatic, joint: q, direction: [3, 4], angle_deg: 90}",
    )
    for q in (0.0, 0.5, 2.0):
        wanted = sqrt((0.8 * q) ** 2 + (1 + 0.6 * q) ** 2)  # (3, 4) / 5 turned by 90 degrees
        assert shape_at(model, np.array([q])).length == pytest.approx([wanted])


def test_a_rolling_frame_follows_equation_five() -> None:
    model = routed(
        "{type: anchor, position: [-1, 0]}\n{type: anchor, frame: link, position: [0.15, 0]}",
        "{name: q, range_deg: [-80, 80]}",
        "{name: link, motion: rolling, joint: q, radius: 0.04}",
    )
    for q in np.radians([-80.0, -20.0, 0.0, 55.0]):
        x, y = 0.08 * cos(q) + 0.15 * cos(2 * q), 0.08 * sin(q) + 0.15 * sin(2 * q)
        assert shape_at(model, np.array([q])).length == pytest.approx([sqrt((x + 1) ** 2 + y**2)])


BODIES = {
    "revolute": "{name: f, motion: revolute, joint: a, origin: [2, 0.5], angle: 0.3}",
    "prismatic": "{name: f, motion: prismatic, joint: a, origin: [2, 0.5], direction: [1, 2]}",
    "rolling": "{name: f, motion: rolling, joint: a, origin: [1.4, 0.5], radius: 0.3}",
}
RANGE = "{name: a, range: [-0.6, 0.6]}"
PULLEYS_CARRIED = """
    {type: winch, motor: m, winding: 1, radius: 0.2, position: [-4, 0], turn: ccw}
    {type: pulley, radius: 0.4, position: [-1, -3], turn: ccw}
    {type: pulley, radius: 0.3, frame: f, position: [0.5, 3], turn: cw}
    {type: pulley, radius: 0.25, frame: f, position: [2, 1], turn: cw}
    {type: anchor, radius: 0.5, frame: f, position: [1, -3], turn: ccw}
"""
ENDS_CARRIED = """
    {type: anchor, radius: 0.3, frame: f, position: [0.4, 0.3], turn: cw}
    {type: pulley, radius: 0.2, frame: f, position: [2.5, -1], turn: cw}
    {type: pulley, radius: 0.6, position: [-2, -3], turn: cw}
    {type: winch, motor: m, winding: 1, radius: 0.2, frame: f, position: [-1, 3], turn: ccw}
"""
CHAIN = (
    """
    {type: winch, motor: m, winding: 1, radius: 0.2, position: [-4, 0], turn: cw}
    {type: pulley, radius: 0.2, frame: f, position: [0.5, 1.5], turn: cw}
    {type: pulley, radius: 0.1, frame: g, position: [0.5, -1], turn: ccw}
    {type: anchor, radius: 0.1, frame: h, position: [0.4, 0.2], turn: ccw}
    """,
    f"{RANGE}, {{name: b, range: [-0.3, 0.4]}}, {{name: d, range: [-0.4, 0.2]}}",
    ", ".join(
        [
            BODIES["revolute"],
            "{name: g, parent: f, motion: rolling, joint: b, radius: 0.2, origin: [1, 0]}",
            "{name: k, parent: g, motion: fixed, origin: [0.5, 0.2], angle: -0.2}",
            "{name: h, parent: k, motion: prismatic, joint: d, direction: [2, -1]}",
        ]
    ),
)
MOVING = {name: (PULLEYS_CARRIED, RANGE, body) for name, body in BODIES.items()}
MOVING |= {f"{name}-ends": (ENDS_CARRIED, RANGE, body) for name, body in BODIES.items()}
MOVING["chain"] = CHAIN


@pytest.mark.parametrize("description", MOVING.values(), ids=MOVING.keys())
def test_elements_change_by_their_lever_arms_and_by_the_motion_of_the_middles(
    description: tuple[str, str, str],
) -> None:
    model = routed(*description)
    joints = model.robot.joints
    lower, upper = np.array([[j.lower, j.upper] for j in joints]).T
    generator = np.random.default_rng(2)
    moved = 0.0
    for _ in range(25):
        angle = lower + generator.random(len(joints)) * (upper - lower)
        arms = shape_at(model, angle).lever_arm
        assert np.abs(arms).max() > 0.01
        for j in range(len(joints)):
            both = law_and_measured(model, angle, j)
            assert both is not None
            law, measured = both
            np.testing.assert_allclose(law, measured, atol=2e-8)
            np.testing.assert_allclose(arms[:, j].sum(), measured.sum(), atol=2e-8)
            moved = max(moved, float(np.abs(measured - arms[:, j]).max()))
    assert moved > 1e-3, "middles of arcs move"


@pytest.mark.parametrize("end", ["before", "both", "after"])
def test_tables_lay_cable_on_from_the_element_at_the_end_that_moves(
    end: MovingEnd, prototype: Robot
) -> None:
    def changed(node: Node) -> Node:
        return replace(node, moving_end=end) if isinstance(node, Pulley) else node

    cables = tuple(
        replace(cable, nodes=tuple(map(changed, cable.nodes))) for cable in prototype.cables
    )
    model = prepare(replace(prototype, cables=cables))
    share = {"before": 1.0, "both": 0.5, "after": 0.0}[end]
    small = 1e-7
    for angle in np.random.default_rng(3).uniform(-0.69, 0.69, 50):
        both = law_and_measured(model, np.array([angle]), 0, small)
        assert both is not None
        np.testing.assert_allclose(*both, atol=2e-8)
        one, other = (shape_at(model, np.array([angle + s])) for s in (small, -small))
        measured = (one.length - other.length) / (2 * small)
        grown = 0.0045 * (one.wrap[[4, 11]] - other.wrap[[4, 11]]) / (2 * small)
        arms = shape_at(model, np.array([angle])).lever_arm[:, 0]
        # pulley 6 of each cable: half of its arc belongs to either element, wherever it grows
        np.testing.assert_allclose(
            arms[[4, 12]], measured[[4, 12]] + (share - 0.5) * grown, atol=2e-8
        )
        np.testing.assert_allclose(
            arms[[5, 13]], measured[[5, 13]] + (0.5 - share) * grown, atol=2e-8
        )
        others = np.setdiff1d(np.arange(16), [4, 5, 12, 13])
        np.testing.assert_allclose(arms[others], measured[others], atol=2e-8)
        assert np.abs(grown).min() > 1e-3


def test_a_wrap_grows_through_half_a_turn_without_a_jump() -> None:
    model = routed(
        """
        {type: anchor, position: [-4, 0]}
        {type: pulley, radius: 1, position: [0, 1], turn: ccw}
        {type: anchor, frame: arm, position: [0, 4]}
        """,
        "{name: q, range_deg: [-120, 120]}",
        "{name: arm, motion: revolute, joint: q, origin: [0, 1], angle_deg: 60}",
    )
    angles = np.radians(np.linspace(-120.0, 120.0, 97))
    wraps = np.array([shape_at(model, np.array([q])).wrap[0] for q in angles])
    np.testing.assert_allclose(np.diff(wraps), np.diff(angles), atol=1e-9)
    assert wraps[0] < pi / 2 < pi < 1.4 * pi < wraps[-1]


def test_half_of_an_arc_belongs_to_each_neighbour(prototype: Robot) -> None:
    shape = shape_at(prepare(prototype), np.zeros(1))
    # upper cable: spans of the file, wraps of Table I; pulley 6 amid its range
    wraps = np.radians([40.9, 105.4, 32.1, 57.7, (0.6 + 78.5) / 2, 180.0, 90.0])
    radii = np.array([11, 11, 11, 6.5, 4.5, 4.5, 4.5]) * 1e-3
    spans = np.array([0.2, 0.1, 0.15, 0.1, 0.08, 0.08, 0.08, 0.05])
    arcs = 0.5 * radii * wraps
    wanted = spans + np.concatenate([[0.0], arcs]) + np.concatenate([arcs, [0.0]])
    np.testing.assert_allclose(shape.length[:8], wanted, atol=1e-12)
    np.testing.assert_allclose(shape.wrap[:7], wraps, atol=1e-12)


def test_the_wraps_of_table_one_are_loaded(prototype: Robot) -> None:
    model = prepare(prototype)
    for degrees, upper, lower in ((-40.0, 0.6, 78.5), (40.0, 78.5, 0.6)):
        wrap = np.degrees(shape_at(model, np.array([radians(degrees)])).wrap)
        constant = [40.9, 105.4, 32.1, 57.7], [180.0, 90.0]
        np.testing.assert_allclose(wrap[:7], [*constant[0], upper, *constant[1]], atol=1e-9)
        np.testing.assert_allclose(wrap[7:], [*constant[0], lower, *constant[1]], atol=1e-9)


def test_the_strands_follow_equation_two(prototype: Robot) -> None:
    model = prepare(prototype)
    middle = shape_at(model, np.zeros(1))
    for angle in np.linspace(-0.69, 0.69, 41):
        shape = shape_at(model, np.array([angle]))
        # element 7 lies between pulley 7 (constant wrap) and pulley 8; no moving arc touches it
        assert shape.length[6] - middle.length[6] == pytest.approx(-0.06 * sin(angle), abs=1e-11)
        assert shape.length[14] - middle.length[14] == pytest.approx(0.06 * sin(angle), abs=1e-11)
        assert shape.lever_arm[6, 0] == pytest.approx(-0.06 * cos(angle), abs=1e-8)
        # element 6 also carries half of pulley 6's arc
        arc = 0.5 * 0.0045 * (shape.wrap[4] - middle.wrap[4])
        assert shape.length[5] - middle.length[5] == pytest.approx(
            -0.06 * sin(angle) + arc, abs=1e-11
        )


def tabled(term: str, wrap: str = "1.0") -> Robot:
    return parse_robot(f"""
        name: tabled
        motors: [{{name: m}}]
        joints: [{{name: q, range: [-1, 1]}}]
        cables:
          - name: c
            axial_stiffness: 1000
            preload: 1
            nodes:
              - {{type: winch, motor: m, winding: 1, radius: 0.1}}
              - {{type: pulley, radius: 0.1, wrap_angle: {wrap}}}
              - {{type: anchor}}
            spans: [0.5, {term}]
        """)


def test_tables_are_joined_by_a_monotone_cubic() -> None:
    angle = [-1.0, -0.4, 0.1, 0.35, 1.0]
    value = [0.2, 0.21, 0.3, 0.4, 0.4]
    model = prepare(tabled(f"{{joint: q, angle: {angle}, value: {value}}}"))
    grid = np.linspace(-1.0, 1.0, 1501)
    lengths = np.array([shape_at(model, np.array([q])).length[1] for q in grid]) - 0.05
    wanted = PchipInterpolator(angle, value)(grid)
    np.testing.assert_allclose(lengths, wanted, atol=1e-5)
    inside = np.min(np.abs(grid[:, None] - np.array(angle)), axis=1) > 2.0 / 256
    np.testing.assert_allclose(lengths[inside], wanted[inside], atol=1e-12)
    assert lengths[0] == pytest.approx(0.2)
    assert lengths[-1] == pytest.approx(0.4)


def test_a_table_that_never_falls_gives_a_length_that_never_falls() -> None:
    angle = [-1.0, -0.4, 0.1, 0.15, 1.0]
    value = [0.2, 0.2, 0.3, 0.7, 0.7]
    model = prepare(tabled(f"{{joint: q, angle: {angle}, value: {value}}}"))
    grid = np.linspace(-1.0, 1.0, 5001)
    lengths = np.array([shape_at(model, np.array([q])).length[1] for q in grid]) - 0.05
    assert lengths.min() >= 0.2 - 1e-12
    assert lengths.max() <= 0.7 + 1e-12
    assert np.all(np.diff(lengths) >= -1e-12)


def test_a_wrap_that_rests_at_zero_is_never_negative() -> None:
    # a cable that touches its pulley in half of the joint's range only
    wrap = "{joint: q, angle: [-1, 0.13, 1], value: [0, 0, 1.2]}"
    model = prepare(tabled("0.5", wrap))
    wraps = [shape_at(model, np.array([q])).wrap[0] for q in np.linspace(-1.0, 1.0, 5001)]
    assert min(wraps) >= 0.0


def test_a_profile_adds_its_terms() -> None:
    terms = "[0.1, {joint: q, offset: 0.2, slope: 0.03, sine: -0.05}, {joint: q, slope: 0.01}]"
    model = prepare(tabled(terms, "[1.5, {joint: q, slope_deg: 10}]"))
    for q in (-1.0, -0.3, 0.0, 0.8, 1.0):
        shape = shape_at(model, np.array([q]))
        wrap = 1.5 + radians(10.0) * q
        assert shape.wrap == pytest.approx([wrap])
        wanted = 0.3 + 0.04 * q - 0.05 * sin(q) + 0.05 * wrap
        assert shape.length[1] == pytest.approx(wanted, abs=1e-11)


def refusal(make: Any, *arguments: Any) -> str:
    with pytest.raises(RobotFileError) as error:
        prepare(make(*arguments)) if make is tabled else make(*arguments)
    message = str(error.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    "second",
    [
        "{type: pulley, radius: 3, position: [1, 0], turn: ccw}",  # one inside the other
        "{type: pulley, radius: 1, position: [1.5, 0], turn: cw}",  # overlapping, crossed
        "{type: pulley, radius: 1, position: [0, 0], turn: ccw}",  # the same place
    ],
)
def test_an_impossible_tangent_is_refused_and_named(second: str) -> None:
    message = refusal(
        routed,
        f"""
        {{type: anchor, position: [-9, 0]}}
        {{type: pulley, radius: 1, position: [0, 0], turn: ccw}}
        {second}
        {{type: anchor, position: [9, 9]}}
        """,
    )
    assert message.startswith("cables[0].nodes[1] and nodes[2] (c) have no common tangent")


def test_a_tangent_that_becomes_impossible_within_the_range_is_refused_with_the_angle() -> None:
    message = refusal(
        routed,
        """
        {type: anchor, position: [-9, 0]}
        {type: pulley, radius: 1, position: [0, 1], turn: ccw}
        {type: anchor, frame: slide, position: [0, 4]}
        """,
        "{name: q, range: [0, 4]}",
        "{name: slide, motion: prismatic, joint: q, direction: [0, -1]}",
    )
    assert message.startswith("cables[0].nodes[1] and nodes[2] (c) have no common tangent at q = ")


def test_a_pulley_that_its_cable_would_leave_is_refused_with_the_angle() -> None:
    message = refusal(
        routed,
        """
        {type: anchor, position: [-4, 0]}
        {type: pulley, radius: 1, position: [0, 1], turn: ccw}
        {type: anchor, frame: slide, position: [4, 0.5]}
        """,
        "{name: q, range: [0, 1]}",
        "{name: slide, motion: prismatic, joint: q, direction: [0, -1]}",
    )
    assert message.startswith("cables[0].nodes[1] (c/2) is left by its cable at q = ")
    assert "the wrap angle is -" in message
    assert "must not be negative" in message


def test_a_tabulated_wrap_that_turns_negative_is_refused() -> None:
    message = refusal(tabled, "0.5", "{joint: q, offset: 0.5, slope: 1}")
    assert message.startswith("cables[0].nodes[1] (c/2) is left by its cable at q = -1")


def test_a_span_that_shrinks_to_nothing_is_refused() -> None:
    message = refusal(tabled, "{joint: q, offset: 0.5, slope: -1}")
    assert message.startswith("cables[0]: element c/2 has the length")
    message = refusal(tabled, "{joint: q, offset: -0.5, slope: 0.1}")
    assert "element c/2 has the length" in message
    assert "reference pose" in message


@pytest.mark.parametrize("name", sorted(path.stem for path in ROBOTS.glob("*.yaml")))
def test_the_arms_of_a_shipped_robot_are_the_derivatives_of_its_cables_lengths(name: str) -> None:
    model = prepare(load_robot(ROBOTS / f"{name}.yaml"))
    first = np.cumsum([0] + [len(cable.nodes) - 1 for cable in model.robot.cables])[:-1]
    lower = np.array([joint.lower for joint in model.robot.joints])
    upper = np.array([joint.upper for joint in model.robot.joints])
    step = 1e-6
    shares = np.random.default_rng(0).uniform(0.3, 0.7, (4, lower.size))
    for pose in lower + shares * (upper - lower):
        arms = np.add.reduceat(shape_at(model, pose).lever_arm, first)
        for joint, one in enumerate(step * np.eye(lower.size)):
            ends = [shape_at(model, pose + sign * one).length for sign in (1.0, -1.0)]
            longer, shorter = (np.add.reduceat(length, first) for length in ends)
            assert arms[:, joint] == pytest.approx((longer - shorter) / (2.0 * step), abs=1e-8)
