"""The part of a robot that fills the picture, and the width of what is drawn in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.model.loading import load_model
from cdrj_ros.report.scene import scene_of
from cdrj_ros.view.picture import extent_of, typical_radius

ROBOTS = sorted(
    path.stem for path in (Path(__file__).parents[2] / "config" / "robots").glob("*.yaml")
)


@pytest.mark.parametrize("name", ROBOTS)
def test_pulleys_are_neither_tiny_nor_huge_in_the_picture(name: str) -> None:
    model = load_model(name)
    low, high = extent_of(model)
    pose = np.array([joint.reference_angle for joint in model.robot.joints])
    share = typical_radius(model, scene_of(model, pose)) / float((high - low).max())
    assert 0.002 < share < 0.3


def test_the_shaft_of_the_wrist_does_not_hide_its_jaws() -> None:
    low, high = extent_of(load_model("wrist"))
    assert (high - low).max() < 0.03
    assert low[0] < 0.0 < high[0]


def test_a_robot_without_long_ends_is_shown_whole() -> None:
    low, high = extent_of(load_model("finger"))
    scene = scene_of(load_model("finger"), np.zeros(2))
    for path in scene.elements:
        assert (path >= low - 1e-12).all()
        assert (path <= high + 1e-12).all()
