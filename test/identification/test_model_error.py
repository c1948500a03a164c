"""What is unknown besides the fitted numbers: numbers fitted along, and the model's own error."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.identification.residual_statistics import model_error
from cdrj_ros.identification.unknowns import fitted_along, parse_unknowns
from cdrj_ros.robot.document import Document
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.robot.tolerances import CATALOGUE_STIFFNESS, SPRING_SCALE, ZERO_BY_EYE

PROTOTYPE = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"


@pytest.fixture(scope="module")
def document() -> Document:
    whole = load_document(PROTOTYPE)[0]
    return {key: value for key, value in whole.items() if key != "uncertainty"}


def along(document: Document, fit: str) -> dict[str, tuple[float, float]]:
    known = build_robot(document, "test").uncertainty
    found = fitted_along(document, known, parse_unknowns(document, fit))
    return {one.name: one.prior for one in found if one.prior is not None}


def test_what_nobody_measured_is_fitted_along_within_its_tolerance(document: Document) -> None:
    priors = along(document, "friction.rho")
    assert priors["cables.upper.preload"] == pytest.approx((36.85, SPRING_SCALE * 36.85))
    assert priors["joints.elbow.reference_angle"] == pytest.approx((0.0, ZERO_BY_EYE))
    mean, stddev = priors["cables.lower.axial_stiffness"]
    assert stddev == pytest.approx(CATALOGUE_STIFFNESS * mean)
    assert "cables.upper.nodes.1.radius (+1)" in priors, "both drums are one"
    assert "cables.lower.nodes.2.bearing_torque (+6)" in priors


def test_what_is_fitted_or_stated_or_exact_is_not_fitted_along(document: Document) -> None:
    assert "cables.upper.preload" not in along(document, "cables.*.preload")
    stated = {"parameters": ["cables.upper.axial_stiffness"], "stddev": [60.0]}
    priors = along({**document, "uncertainty": stated}, "friction.rho")
    assert "cables.upper.axial_stiffness" not in priors
    assert "cables.lower.axial_stiffness" in priors
    assert not along({**document, "uncertainty": {"others": "exact"}}, "friction.rho")


def runs(error: float, count: int = 8, bias: float = 0.0) -> list[np.ndarray]:
    """Residuals of runs: a slow error of random phase, white noise of 0.05, and a bias per run."""
    generator = np.random.default_rng(0)
    time = np.linspace(0.0, 20.0, 2000)
    return [
        error * np.sqrt(2.0) * np.sin(time + generator.uniform(0.0, 6.0))
        + generator.normal(0.0, 0.05, time.size)
        + bias * generator.standard_normal()
        for _ in range(count)
    ]


def inside(residuals: list[np.ndarray], stddev: float) -> list[float]:
    return [float(np.mean(np.abs(one) <= 2.0 * stddev)) for one in residuals]


def test_the_models_error_is_what_the_numbers_lack_to_cover_runs_left_out() -> None:
    residuals = runs(0.3)
    found = model_error(residuals, [np.full(one.size, 0.1) for one in residuals])
    assert np.mean(inside(residuals, np.hypot(found, 0.1))) == pytest.approx(0.95, abs=0.002)
    assert model_error(residuals, [np.full(one.size, 0.05) for one in residuals]) > found


def test_a_normal_error_is_found_as_it_is() -> None:
    generator = np.random.default_rng(0)
    residuals = [generator.normal(0.0, 0.3, 4000) for _ in range(8)]
    found = model_error(residuals, [np.zeros(4000)] * 8)
    assert found == pytest.approx(0.3 * 1.96 / 2.0, rel=0.03)  # within 2 of it are 95 %


def test_runs_that_differ_widen_it() -> None:
    residuals = [*runs(0.1, 39), *runs(0.6, 1)]
    found = model_error(residuals, [np.full(one.size, 0.05) for one in residuals])
    covered = inside(residuals, np.hypot(found, 0.05))
    assert min(covered) == pytest.approx(0.8, abs=0.01)
    assert np.mean(covered) > 0.98


def test_a_right_model_has_none() -> None:
    residuals = runs(0.1)
    assert model_error(residuals, [np.full(one.size, 0.12) for one in residuals]) == 0.0


def test_two_runs_are_covered_by_what_eight_others_say() -> None:
    residuals = runs(0.2, count=10, bias=0.2)
    error = model_error(residuals[:8], [np.full(2000, 0.02)] * 8)
    inside = [np.mean(np.abs(one) <= 2.0 * np.hypot(error, 0.02)) for one in residuals[8:]]
    assert np.mean(inside) >= 0.9


def test_a_wrong_stiffness_does_not_spoil_the_fit_of_friction_and_preload() -> None:
    path = Path(__file__).parents[2] / "tools" / "narrow_fits.py"
    spec = importlib.util.spec_from_file_location("narrow_fits", path)
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    wrong = tool.WRONG["EA by 5 %"]
    assert tool.errors(wrong, 8.0, wide=False).mean() > 0.01
    assert tool.errors(wrong, 8.0, wide=True).max() < 0.003
