"""What is drawn follows from estimates alone: colours, meshes, curves, the table and the page."""

import re

import numpy as np
import pytest

from cdrj_ros.model.packing import INVALID, SLACK, STALE, UNSURE
from cdrj_ros.model.prepared import load_model
from cdrj_ros.report.scene import LIMIT_COLOUR
from cdrj_ros.view.drawing import Drawing
from cdrj_ros.view.history import History, columns_of, nothing_known
from cdrj_ros.view.page import Page
from cdrj_ros.view.panels import TimeAxis, table_of
from cdrj_ros.view.picture import PALE, SLIPPING, STICKING, THIN, UNKNOWN, extent_of, picture_of


@pytest.fixture(scope="module")
def model():
    return load_model("finger")


@pytest.fixture
def shown(model):
    elements, pulleys = len(model.layout.elements), len(model.layout.pulleys)
    return nothing_known(model)._replace(
        stamp_ns=1, tension=np.full(elements, 18.0),
        stddev=np.full(elements, 0.5), status=np.zeros(elements, np.uint8),
        force=np.ones((pulleys, 3)), friction=np.zeros(pulleys), slip_speed=np.zeros(pulleys),
        pulley_status=np.zeros(pulleys, np.uint8),
    )  # fmt: skip


def test_flags_and_tension_decide_colour_width_and_dashes(model, shown):
    shown.tension[:3] = model.robot.cables[0].maximum_tension, 0.0, np.nan
    shown.status[1:6] = SLACK, 0, UNSURE, STALE, INVALID
    high, slack, unknown, unsure, stale, invalid = picture_of(model, shown).cables[:6]
    assert high.colour == pytest.approx(LIMIT_COLOUR)
    assert slack.width == pytest.approx(THIN * high.width)
    assert unsure.opacity == PALE
    assert high.opacity == 1.0
    assert [one.dashed for one in (high, slack, unknown, unsure, stale, invalid)] == [
        False, False, True, False, True, True,
    ]  # fmt: skip
    assert stale.colour == invalid.colour == unknown.colour == UNKNOWN
    assert high.label == "deep/1 150.0 ± 1.0 N"
    assert stale.label == "deep/5 ?"


def test_a_pulley_is_coloured_by_slip_and_an_unknown_force_has_no_arrow(model, shown):
    shown.slip_speed[0] = -1e-3
    shown.pulley_status[1] = INVALID
    picture = picture_of(model, shown)
    colours = {one.body.name: one.colour for one in picture.bodies}
    assert colours[model.layout.pulleys[0]] == SLIPPING
    assert colours[model.layout.pulleys[2]] == STICKING
    ends = {picture.bodies[one.body].body.name: one.end for one in picture.arrows}
    assert np.isnan(ends[model.layout.pulleys[1]]).all()
    assert np.isfinite(ends[model.layout.pulleys[0]]).all()


def test_the_history_keeps_the_last_values_and_begins_again_if_time_goes_back(model, shown):
    history = History(4)
    for stamp in (10, 20, 20, 30, 40, 50):
        history.add(shown._replace(stamp_ns=stamp, tension=shown.tension + stamp))
    table = history.table()
    np.testing.assert_array_equal(table.stamp_ns, [20, 30, 40, 50])
    np.testing.assert_array_equal(table.tension[:, 0], [38.0, 48.0, 58.0, 68.0])
    history.add(shown._replace(stamp_ns=5, status=shown.status | np.uint8(STALE)))
    table = history.table()
    assert table.stamp_ns.tolist() == [5]
    assert np.isnan(table.curves(model.layout, "element deep/1", 0).tension).all()


def test_columns_follow_the_names_and_not_the_order_of_a_message():
    class Message:
        name = ("b", "a", "x")
        tension = (2.0, 1.0, 9.0)
        stddev = ()

    found = columns_of(Message, ("tension", "stddev"), ("a", "b", "c"))
    np.testing.assert_array_equal(found["tension"], [1.0, 2.0, np.nan])
    assert np.isnan(found["stddev"]).all()


def test_the_table_says_tension_and_status(model, shown):
    shown.status[0] = INVALID
    text = table_of(model, shown, picture_of(model, shown), "deep/2")
    assert "INVALID" in text
    assert "18.0 ± 1.0 N" in text


def test_the_table_of_a_hand_has_a_line_per_cable_the_worst_first():
    hand = load_model("hand")
    names = hand.layout.elements
    still = nothing_known(hand)
    shown = still._replace(tension=np.full(len(names), 9.0), status=np.zeros(len(names), np.uint8))
    shown.tension[names.index("ring_adductor/2")] = 11.0
    shown.status[names.index("thumb_pip_flexor/3")] = SLACK
    chosen = "index_abductor/1"
    text = table_of(hand, shown, picture_of(hand, shown), chosen)
    lines = re.findall("[a-z_]+/[0-9]", text)
    cables = [cable.name for cable in hand.robot.cables]
    assert lines[0] == "thumb_pip_flexor/3"
    assert "ring_adductor/2" in lines
    assert {line.split("/")[0] for line in lines} == set(cables)
    of_chosen = [name for name in lines if name.startswith("index_abductor/")]
    assert of_chosen == [f"index_abductor/{e}" for e in (1, 2, 3)]
    assert len(lines) == len(cables) + 2


def test_shapes_of_bodies_follow_the_joints_in_the_browser():
    viser = pytest.importorskip("viser")
    robot = load_model("finger3d")
    server = viser.ViserServer(host="localhost", port=0, verbose=False)
    try:
        drawing = Drawing(server.scene, robot, lambda _: None)
        still = nothing_known(robot)
        bent = still._replace(angle=np.array([0.0, 0.8, 0.0]))
        places = []
        for shown in (still, bent):
            drawing.update(picture_of(robot, shown), "", "none", False)
            places.append({k: (v.position.copy(), v.wxyz.copy())
                           for k, v in drawing.visuals.items()})  # fmt: skip
    finally:
        server.stop()
    assert len(places[0]) == len(robot.robot.visuals) == 8
    palm, proximal, sphere = (np.concatenate(places[1][k]) - np.concatenate(places[0][k])
                              for k in range(3))  # fmt: skip
    assert not palm.any()
    assert not sphere[:3].any(), "its centre is that of the joint"
    (start, *_), (end, turned) = places[0][1], places[1][1]
    assert 2.0 * np.arccos(abs(turned @ places[0][1][1])) == pytest.approx(0.8, abs=1e-6)
    scale = drawing.size[0] / np.ptp([low_or_high[0] for low_or_high in extent_of(robot)])
    # the middle of the bone, 19.89 mm from the joint, moves on a circle by 0.8 rad
    assert np.linalg.norm(end - start) == pytest.approx(scale * 2 * 0.01989 * np.sin(0.4))
    assert proximal.any()


def test_the_first_estimate_appears_in_table_and_picture_at_once():
    pytest.importorskip("viser")
    model = load_model("davinci_jaw")
    page = Page(model, "localhost", 0, "title", TimeAxis("t", 0.0, 1.0))
    try:
        assert page._table.content == "", "no estimate is not an invalid one"
        page.show(nothing_known(model), None, ())
        n = len(model.layout.elements)
        first = nothing_known(model)._replace(
            stamp_ns=1, tension=np.full(n, 14.9), stddev=np.full(n, 0.25),
            status=np.zeros(n, np.uint8),
        )  # fmt: skip
        page.show(first, None, ())
        assert page._table.content.count("14.9 ± 0.5 N") == n
        assert "INVALID" not in page._table.content
        (label,) = page.drawing._labels.values()
        assert label.text == f"{model.layout.elements[0]} 14.9 ± 0.5 N", "others would cover it"
    finally:
        page.close()
