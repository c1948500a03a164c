"""The scene of a live picture agrees with the model's geometry, and its colours with tensions."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import shape_at
from cdrj_ros.report.scene import LIMIT_COLOUR, SLACK_COLOUR, scene_of, tension_colour
from cdrj_ros.view.picture import extent_of, typical_radius

ROBOTS = sorted(
    path.stem for path in (Path(__file__).parents[2] / "config" / "robots").glob("*.yaml")
)


@pytest.mark.parametrize("name", ["finger", "parallel", "hoist", "prototype_positions"])
def test_the_drawn_elements_are_as_long_as_the_cables(name: str) -> None:
    model = load_model(name)
    joints = model.robot.joints
    for share in (0.2, 0.5, 0.8):
        pose = np.array([axis.lower + share * (axis.upper - axis.lower) for axis in joints])
        scene = scene_of(model, pose)
        assert len(scene.elements) == len(model.layout.elements)
        first = 0
        for cable in model.robot.cables:
            count = len(cable.nodes) - 1
            paths = scene.elements[first : first + count]
            drawn = sum(np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in paths)
            exact = shape_at(model, pose).length[first : first + count].sum()
            assert drawn == pytest.approx(exact, rel=1e-3)
            for before, after in pairwise(paths):
                np.testing.assert_allclose(before[-1], after[0], atol=1e-12)
            first += count


def test_a_cable_given_by_tables_is_drawn_unrolled() -> None:
    model = load_model("prototype")
    scene = scene_of(model, np.zeros(1))
    lengths = [np.linalg.norm(np.diff(path, axis=0)) for path in scene.elements]
    np.testing.assert_allclose(lengths, shape_at(model, np.zeros(1)).length, rtol=1e-12)
    rows = {round(float(path[0, 1]), 9) for path in scene.elements}
    assert len(rows) == 2, "one line per cable"
    assert [body.name for body in scene.bodies[:2]] == ["upper/1", "upper/2"]
    assert [body.kind for body in scene.bodies[7:9]] == ["pulley", "anchor"]


def test_colours_run_from_slack_to_the_limit() -> None:
    assert tension_colour(0.0, 30.0, 120.0) == pytest.approx(SLACK_COLOUR)
    assert tension_colour(120.0, 30.0, 120.0) == pytest.approx(LIMIT_COLOUR)
    assert tension_colour(500.0, 30.0, 120.0) == pytest.approx(LIMIT_COLOUR)
    reds = [tension_colour(t, 30.0, np.inf)[0] for t in (30.0, 60.0, 90.0)]
    assert reds == sorted(reds)
    assert tension_colour(10.0, 0.0, 0.5) == pytest.approx(LIMIT_COLOUR), "no preload"


@pytest.mark.parametrize("name", ["cdpr", "exosuit"])
def test_the_elements_of_a_cable_in_space_meet(name: str) -> None:
    model = load_model(name)
    reference = np.array([axis.reference_angle for axis in model.robot.joints])
    scene = scene_of(model, reference)
    assert len(scene.elements) == len(model.layout.elements)
    first = 0
    for cable in model.robot.cables:
        count = len(cable.nodes) - 1
        paths = scene.elements[first : first + count]
        for before, after in pairwise(paths):
            np.testing.assert_allclose(before[-1], after[0], atol=1e-12)
        assert all(np.isfinite(path).all() for path in paths)
        first += count
    assert np.ptp(np.concatenate(scene.elements)[:, 2]) > 0.01, "not in a plane"


@pytest.mark.parametrize("name", ROBOTS)
def test_the_robot_fills_the_picture_with_pulleys_neither_tiny_nor_huge(name: str) -> None:
    model = load_model(name)
    low, high = extent_of(model)
    scene = scene_of(model, np.array([joint.reference_angle for joint in model.robot.joints]))
    share = typical_radius(model, scene) / float((high - low).max())
    assert 0.002 < share < 0.3
    for path in scene.elements if name == "finger" else ():  # without long ends: all of it
        assert (path >= low - 1e-12).all()
        assert (path <= high + 1e-12).all()


@pytest.mark.parametrize(("name", "size"), [("wrist", 0.03), ("finger3d", 0.15)])
def test_long_ends_do_not_hide_the_rest(name: str, size: float) -> None:
    low, high = extent_of(load_model(name))
    assert (high - low).max() < size
    assert low[0] < 0.0 < high[0]
