"""The scene of a live picture agrees with the model's geometry, and its colours with tensions."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import shape_at
from cdrj_ros.report.scene import LIMIT_COLOUR, SLACK_COLOUR, scene_of, tension_colour


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
