"""Properties that the source describes for its figures 9 and 12 to 14, tested on our curves."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdrj_ros.robot.reader import load_robot
from examples.paper import study as study_module
from examples.paper.runs import Motion
from examples.paper.study import (
    Result,
    Study,
    errors_of,
    features,
    first_cycle,
    work,
)

PROTOTYPE = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"

NODE_3, LAST, WINCH = "nodal_force/{}/3", "tension/{}/8", "tension/{}/1"


@pytest.fixture(scope="module")
def study() -> Study:
    shares: list[float] = []
    made = work(
        load_robot(PROTOTYPE), Motion(cycles=1, rate=250.0), cells=2, progress=shares.append
    )
    assert shares[-1] == 1.0
    assert min(shares) >= 0.0
    return made


def of_rig(result: Result, name: str) -> dict[str, float]:
    channel = first_cycle(result, result.used(name))
    return features(result, channel, channel.reference)


def of_estimate(result: Result, name: str) -> dict[str, float]:
    channel = first_cycle(result, result.used(name))
    return features(result, channel, channel.estimate)


@pytest.mark.parametrize("seen_by", [of_rig, of_estimate])
def test_forces_draw_an_m_in_the_upper_cable_and_a_w_in_the_lower(study: Study, seen_by) -> None:  # type: ignore[no-untyped-def]
    for result in study.results:
        for pattern in (NODE_3, WINCH):
            upper = seen_by(result, pattern.format("upper"))
            lower = seen_by(result, pattern.format("lower"))
            # one arch per stroke in the upper cable, one trough per stroke in the lower
            assert min(upper["bulge_down"], upper["bulge_up"]) > 0.9
            assert max(lower["bulge_down"], lower["bulge_up"]) < -0.6
        assert seen_by(result, NODE_3.format("upper"))["humps"] == 2
        assert seen_by(result, NODE_3.format("lower"))["humps"] == 2


def test_errors_are_of_the_sources_size_with_its_rho_and_a_tenth_with_the_right_one(
    study: Study,
) -> None:
    for result, published in zip(study.results, (0.1365, 0.0444), strict=True):
        common = errors_of(result.common, LAST).mean_relative_error
        known = errors_of(result.identified, LAST).mean_relative_error
        assert common is not None
        assert known is not None
        assert published / 2.0 < common < published * 2.0
        assert known < 0.15 * common
        for pattern, limit in ((NODE_3, 0.01), ("friction/{}/3", 0.03)):
            assert errors_of(result.identified, pattern).mean_relative_error < limit  # type: ignore[operator]


def test_the_numbers_of_figures_json_are_those_of_the_curves(study: Study) -> None:
    told = study_module.numbers(study)
    low = told["experiments"]["first"]["channels"]["nodal_force/upper/3"]
    assert low["rig"] == of_rig(study.results[0], "nodal_force/upper/3")
    assert low["error"]["n"] == pytest.approx(100 * study.motion.period, abs=10)
    assert told["free"]["rho 1"]["winch_difference_down"] < 0.0


# Its tables and figures: here, because the study takes some seconds ------------------------------
