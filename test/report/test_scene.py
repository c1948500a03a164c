"""A scene agrees with the geometry of the core, and its colours with tensions."""

import numpy as np
import pytest

from cdrj_ros.model.prepared import load_model, prepare, shape_at
from cdrj_ros.report.scene import LIMIT_COLOUR, SLACK_COLOUR, scene_of, tension_colour
from cdrj_ros.robot.reader import parse_robot

ROBOT = """
name: drawn
motors: []
joints: [{name: q, range: [-0.3, 0.3]}]
frames: [{name: arm, motion: revolute, joint: q, origin: [0.3, 0, 0], axis: [0, 0, 1]}]
cables:
  - name: a
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: anchor, position: [-0.2, 0.0, -0.1]}
      - {type: swivel, radius: 0.03, position: [-0.2, 0, 0], axis: [0, 0, 1]}
      - {type: cylinder, radius: 0.04, position: [0, 0.01, 0], axis: [0.3, 0.1, 1], turn: cw, turns: 1}
      - {type: sphere, radius: 0.03, position: [0.15, 0.02, 0]}
      - {type: pulley, radius: 0.02, position: [0.05, 0, 0], frame: arm, axis: [0.1, 0, 1], turn: cw}
      - {type: sphere, radius: 0.01, position: [0.1, -0.3, 0]}
      - {type: anchor, position: [0.1, -0.1, 0], frame: arm}
"""  # noqa: E501


def test_a_drawn_cable_is_as_long_as_the_computed_one():
    model = prepare(parse_robot(ROBOT))
    for angle in (-0.2, 0.0, 0.25):
        paths = scene_of(model, np.array([angle])).elements
        shape = shape_at(model, np.array([angle]))
        assert len(paths) == 6
        assert len(paths[4]) > 2, "on the pulley"
        assert len(paths[5]) == 2, "straight on, since it does not touch the far sphere"
        line = np.vstack([paths[0], *(path[1:] for path in paths[1:])])
        drawn = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert drawn == pytest.approx(shape.length.sum(), rel=1e-3)
        # no corner is sharper than a step of an arc: the line is smooth where it touches
        steps = np.diff(line, axis=0)
        steps = steps[np.linalg.norm(steps, axis=1) > 1e-12]
        steps /= np.linalg.norm(steps, axis=1)[:, None]
        corners = np.arccos(np.clip((steps[1:] * steps[:-1]).sum(axis=1), -1.0, 1.0))
        assert corners.max() < 0.2


def test_a_cable_given_by_tables_is_drawn_unrolled():
    model = load_model("prototype")
    scene = scene_of(model, np.zeros(1))
    lengths = [np.linalg.norm(np.diff(path, axis=0)) for path in scene.elements]
    np.testing.assert_allclose(lengths, shape_at(model, np.zeros(1)).length, rtol=1e-12)
    rows = {round(float(path[0, 1]), 9) for path in scene.elements}
    assert len(rows) == 2, "one line per cable"
    assert [body.name for body in scene.bodies[:2]] == ["upper/1", "upper/2"]
    assert [body.kind for body in scene.bodies[7:9]] == ["pulley", "anchor"]


def test_colours_run_from_slack_to_the_limit():
    assert tension_colour(0.0, 30.0, 120.0) == pytest.approx(SLACK_COLOUR)
    assert tension_colour(120.0, 30.0, 120.0) == pytest.approx(LIMIT_COLOUR)
    assert tension_colour(500.0, 30.0, 120.0) == pytest.approx(LIMIT_COLOUR)
    reds = [tension_colour(t, 30.0, np.inf)[0] for t in (30.0, 60.0, 90.0)]
    assert reds == sorted(reds)
    assert tension_colour(10.0, 0.0, 0.5) == pytest.approx(LIMIT_COLOUR), "no preload"
