"""What is unknown besides the fitted numbers: numbers fitted along, and the model's own error."""

import re

import numpy as np
import pytest
from support.made_up import recording
from support.places import PROTOTYPE

from cdrj_ros.estimation.model_error import unmodelled
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.priors import fitted_along, known_before
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.residual_statistics import model_error
from cdrj_ros.identification.unknowns import parse_unknowns, with_priors
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.robot.tolerances import (
    BLEND,
    CATALOGUE_STIFFNESS,
    HANDBOOK_FRICTION,
    SPRING_SCALE,
    ZERO_BY_EYE,
)


@pytest.fixture(scope="module")
def document():
    whole = load_document(PROTOTYPE)[0]
    return {key: value for key, value in whole.items() if key != "uncertainty"}


def along(document, fit):
    known = build_robot(document, "test").uncertainty
    found = fitted_along(document, known, parse_unknowns(document, fit))
    return {one.name: one.prior for one in found if one.prior is not None}


def test_what_nobody_measured_is_fitted_along_within_its_tolerance(document):
    priors = along(document, "friction.rho")
    assert priors["cables.upper.preload"] == pytest.approx((36.85, SPRING_SCALE * 36.85))
    assert priors["joints.elbow.reference_angle"] == pytest.approx((0.0, ZERO_BY_EYE))
    mean, stddev = priors["cables.lower.axial_stiffness"]
    assert stddev == pytest.approx(CATALOGUE_STIFFNESS * mean)
    assert "cables.upper.nodes.1.radius (+1)" in priors, "both drums are one"
    assert "cables.lower.nodes.2.bearing_torque (+6)" in priors


def test_what_is_fitted_or_stated_or_exact_is_not_fitted_along(document):
    assert "cables.upper.preload" not in along(document, "cables.*.preload")
    stated = {"parameters": ["cables.upper.axial_stiffness"], "stddev": [60.0]}
    priors = along({**document, "uncertainty": stated}, "friction.rho")
    assert "cables.upper.axial_stiffness" not in priors
    assert "cables.lower.axial_stiffness" in priors
    assert not along({**document, "uncertainty": {"others": "exact"}}, "friction.rho")


def priors(document, fit):
    known = build_robot(document, "test").uncertainty
    return {u.name: u.prior for u in known_before(document, known, parse_unknowns(document, fit))}


def test_a_named_number_keeps_what_the_file_knows_of_it(document):
    found = priors(document, "preload,rho,cables.upper.nodes.3.friction.mu_c,joints.elbow.scale")
    assert found["cables.upper.preload"] == pytest.approx((36.85, SPRING_SCALE * 36.85))
    assert found["cables.lower.friction.rho"] == pytest.approx((0.2, BLEND)), "the whole robot's"
    mu_c = found["cables.upper.nodes.3.friction.mu_c"]
    assert mu_c == pytest.approx((0.15, HANDBOOK_FRICTION * 0.15))
    assert found["joints.elbow.scale"] is None, "nothing is known of it"
    assert priors(document, "cables.*.preload")["cables.upper.preload (+1)"] == pytest.approx(
        (31.555, np.hypot(SPRING_SCALE * 31.555, 5.295))
    )
    assert priors({**document, "uncertainty": {"others": "exact"}}, "rho") == {
        "cables.upper.friction.rho": None, "cables.lower.friction.rho": None,
    }  # fmt: skip


def test_what_the_file_states_is_no_prior_as_a_fit_may_have_found_it(document):
    stated = {"parameters": ["cables.upper.preload"], "stddev": [0.4]}
    again = priors({**document, "uncertainty": stated}, "preload")
    assert again["cables.upper.preload"] is None
    assert again["cables.lower.preload"] is not None


def test_a_prior_is_dropped_on_purpose_alone(document):
    known = build_robot(document, "test").uncertainty
    named = known_before(document, known, parse_unknowns(document, "preload,rho"))
    free = dict.fromkeys(["cables.upper.preload", "rho"])
    left = {u.name for u in with_priors(named, free) if u.prior}
    assert left == {"cables.lower.preload"}
    with pytest.raises(UsageError, match="EA is not among the fitted"):
        with_priors(named, {"EA": None})


def runs(error, count=8, bias=0.0):
    """Residuals of runs: a slow error of random phase, white noise of 0.05, and a bias per run."""
    generator = np.random.default_rng(0)
    time = np.linspace(0.0, 20.0, 2000)
    return [
        error * np.sqrt(2.0) * np.sin(time + generator.uniform(0.0, 6.0))
        + generator.normal(0.0, 0.05, time.size)
        + bias * generator.standard_normal()
        for _ in range(count)
    ]


def inside(residuals, stddev):
    return [float(np.mean(np.abs(one) <= 2.0 * stddev)) for one in residuals]


def test_the_models_error_is_what_the_numbers_lack_to_cover_runs_left_out():
    residuals = runs(0.3)
    found = model_error(residuals, [np.full(one.size, 0.1) for one in residuals])
    assert np.mean(inside(residuals, np.hypot(found, 0.1))) == pytest.approx(0.95, abs=0.002)
    assert model_error(residuals, [np.full(one.size, 0.05) for one in residuals]) > found


def test_a_normal_error_is_found_as_it_is():
    generator = np.random.default_rng(0)
    residuals = [generator.normal(0.0, 0.3, 4000) for _ in range(8)]
    found = model_error(residuals, [np.zeros(4000)] * 8)
    assert found == pytest.approx(0.3 * 1.96 / 2.0, rel=0.03)  # within 2 of it are 95 %


def test_runs_that_differ_widen_it():
    residuals = [*runs(0.1, 39), *runs(0.6, 1)]
    found = model_error(residuals, [np.full(one.size, 0.05) for one in residuals])
    covered = inside(residuals, np.hypot(found, 0.05))
    assert min(covered) == pytest.approx(0.8, abs=0.01)
    assert np.mean(covered) > 0.98


def test_a_right_model_has_none():
    residuals = runs(0.1)
    assert model_error(residuals, [np.full(one.size, 0.12) for one in residuals]) == 0.0


def test_what_a_fit_leaves_above_the_sensors_noise_is_the_models_error_and_its_first_note(document):
    exact = {**document, "uncertainty": {"others": "exact"}}
    rough = with_numbers(exact, {"friction.mu_c": 0.19})  # the truth, which the file gets wrong
    channels = Settings(channels=("tension/*/8",), coarse=True)
    wrong, right = (
        identify(exact, "test", parse_unknowns(exact, "preload"), [recorded], channels)
        for recorded in (recording(rough, 10.0), recording(exact, 10.0))
    )
    for left in wrong.unexplained.values():
        assert left.noise == pytest.approx(0.02, rel=0.2)
        assert left.error == pytest.approx(left.rms, rel=0.5)
        assert left.error > 0.1
    assert re.match(r"The residual of tension/\w+/8 is .* times the noise", wrong.findings[0])
    assert all(left.error < 0.005 for left in right.unexplained.values())
    assert not any("residual" in sentence for sentence in right.findings)


def test_a_cable_that_was_not_looked_at_has_an_error_of_the_model_too(document):
    stated = {"others": "exact", "model_error": {"tension/upper/8": 0.5}}
    variance = unmodelled(prepare(build_robot({**document, "uncertainty": stated}, "test")))[0]
    assert variance[:8] == pytest.approx(0.5**2)
    assert variance[8:16] == pytest.approx((0.5 * 26.26 / 36.85) ** 2)
