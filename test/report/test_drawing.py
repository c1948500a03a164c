"""Drawings agree with the geometry of the robot."""

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.inspection.ranges import inspect_robot
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.report.drawing import draw_robot, write_png
from cdrj_ros.robot.reader import load_robot, parse_robot

NAMES = ("prototype", "prototype_positions", "finger3d", "exosuit")
"""By tables, by positions in the plane, with shapes, and with bodies in space."""

MIXED = """\
name: mixed
motors: [{name: m}]
joints: [{name: q, range: [-0.5, 0.5]}]
frames: [{name: arm, motion: revolute, joint: q, origin: [1, 0]}]
cables:
  - name: by_spans
    axial_stiffness: 1000
    preload: 5
    nodes:
      - {type: winch, motor: m, winding: 1, radius: 0.01}
      - {type: pulley, radius: 0.02, wrap_angle: 1.5}
      - {type: anchor}
    spans: [0.5, {joint: q, offset: 0.4, slope: 0.1}]
  - name: by_positions
    axial_stiffness: 1000
    preload: 5
    nodes:
      - {type: winch, motor: m, winding: -1, radius: 0.05, position: [0, 0], turn: ccw}
      - {type: pulley, radius: 0.04, position: [0.5, 0.3], turn: cw}
      - {type: anchor, radius: 0.1, frame: arm, position: [0, 0], turn: cw}
"""


def texts(figure):
    found = [text.get_text() for text in figure.texts]
    for legend in figure.legends:
        found += [text.get_text() for text in legend.get_texts()]
    for axes in figure.axes:
        found += [text.get_text() for text in axes.texts]
        legend = axes.get_legend()
        found += [text.get_text() for text in legend.get_texts()] if legend else []
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_is_drawn_with_its_names_and_numbers(name, tmp_path):
    inspection = inspect_robot(prepare(load_robot(ROBOTS / f"{name}.yaml")))
    figure = draw_robot(inspection)
    found = texts(figure)
    assert figure.get_suptitle().startswith(name)
    for cable in inspection.cables:
        assert cable.name in found
    numbers = sum(text.isdigit() for text in found)
    assert numbers == len(figure.axes) * len(inspection.model.layout.elements)
    write_png(figure, str(tmp_path / "robot.png"))
    header = (tmp_path / "robot.png").read_bytes()[:24]
    assert header.startswith(b"\x89PNG")
    width, height = (int.from_bytes(header[at : at + 4], "big") for at in (16, 20))
    assert 600 <= width <= 2200
    assert 300 <= height <= 2200


def test_a_robot_of_both_kinds_shows_both():
    figure = draw_robot(inspect_robot(prepare(parse_robot(MIXED))))
    assert {"by_spans", "by_positions"} <= set(texts(figure))


@pytest.mark.parametrize("name", ["flexor", "left_shoulder_flexor"])
def test_the_legend_of_a_narrow_robot_lies_within_the_picture(name, tmp_path):
    text = MIXED.replace("by_positions", name).replace("[1, 0]}", "[0.3, 2]}")
    figure = draw_robot(inspect_robot(prepare(parse_robot(text))))
    figure.savefig(tmp_path / "robot.png")
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.x1


def test_many_cables_have_the_colours_and_the_legend_of_their_parts():
    figure = draw_robot(inspect_robot(load_model("hand")))
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert {"index", "middle", "ring", "little", "thumb"} <= set(labels)
    assert len(labels) < 14
    named = {text.get_text(): line.get_color() for text, line in zip(
        legend.get_texts(), legend.get_lines(), strict=True)}  # fmt: skip
    assert len({named[name] for name in ("index", "middle", "ring", "little", "thumb")}) == 5
    drawn = [line.get_color() for line in figure.axes[0].lines if line.get_linewidth() == 1.9]
    assert drawn.count(named["index"]) == 18, "three elements of six cables"
    assert "the first 6 of 17 joints" in figure.get_suptitle()


def test_drums_at_ends_that_are_cut_off_widen_no_picture_and_ticks_are_not_rounded():
    """Those of the wrist stand 0.4 m from an instrument of 20 mm."""
    figure = draw_robot(inspect_robot(prepare(load_robot(ROBOTS / "wrist.yaml"))))
    assert "cut off" in figure.get_suptitle()
    for axes in figure.axes:
        assert max(np.ptp(axes.dataLim.get_points(), axis=0)) < 0.05
    shown = figure.axes[0].yaxis.get_major_formatter()
    ticks = [shown(value, 0) for value in (-0.0025, -0.0, 0.0075, 0.3)]
    assert ticks == ["-2.5", "0", "7.5", "300"], "between whole millimetres"
