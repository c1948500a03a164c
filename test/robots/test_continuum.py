"""The identified robot file of a wire-driven continuum instrument: laws that its numbers keep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import build_robot, load_document

ROBOT = Path(__file__).resolve().parents[2] / "config" / "robots" / "continuum.yaml"
PRELOAD = (2.318132, 1.423510)
"""Tension of both wires in the straight pose, as identified [N]."""
WIRE_DISTANCE = 3.63e-3
"""Distance of a wire from the middle of the arcs in the software that drives the instrument [m]."""


def tensions(pulled_mm: float, bend: float) -> tuple[float, float]:
    """Tension of both wires at the drives: wire 0 pulled, wire 1 let out, no friction."""
    document, source = load_document(ROBOT)
    document["friction"]["law"] = "none"
    model = prepare(build_robot(document, source))
    screws = np.array([pulled_mm, -pulled_mm]) * np.pi
    _, estimate = step(model, initial_state(model), Sample(1, screws, np.full(8, bend / 8.0)))
    by_name = dict(zip(model.layout.elements, estimate.tension, strict=True))
    return float(by_name["wire_0/1"]), float(by_name["wire_1/1"])


def test_both_wires_have_their_preload_in_the_straight_pose() -> None:
    assert tensions(0.0, 0.0) == pytest.approx(PRELOAD, rel=1e-4)


def test_pulling_a_wire_tightens_it_until_the_arcs_give_way() -> None:
    held = tensions(1.0, 0.0)
    assert held[0] > PRELOAD[0] + 5.0
    assert held[1] < PRELOAD[1]
    gave_way = tensions(1.0, -1.0 / 3.63)
    assert abs(gave_way[0] - PRELOAD[0]) < 2.0


def test_bending_to_either_side_tightens_the_wire_on_the_far_side() -> None:
    for bend, far, near in ((0.4, 0, 1), (-0.4, 1, 0)):
        tension = tensions(0.0, bend)
        assert tension[far] > PRELOAD[far] + 5.0
        assert tension[near] < PRELOAD[near]


def test_the_fitted_paths_agree_with_the_documented_distance_of_the_wires() -> None:
    document, _ = load_document(ROBOT)
    for cable, sign in zip(document["cables"], (1.0, -1.0), strict=True):
        slopes = [sign * term["slope"] for term in cable["spans"][1][1:]]
        assert np.mean(slopes) == pytest.approx(WIRE_DISTANCE, rel=0.1)
