"""Standard errors: those of truths drawn from what a robot file leaves open, and their parts.

``CDRJ_DRAWS=24`` prints the figures of docs/identification.md with ``-s``.
"""

import os

import numpy as np
import pytest
from support.made_up import recording
from support.places import PROTOTYPE

from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.nuisance import nuisance_causes
from cdrj_ros.identification.priors import unknown_causes
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.residual_statistics import (
    Linear,
    Places,
    lasting_variance,
    residual_variance,
)
from cdrj_ros.identification.unknowns import parse_unknowns
from cdrj_ros.robot.parameters import number_at, with_numbers
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.robot.tolerances import DRAWN_RADIUS, HANDBOOK_FRICTION, default_tolerances

FIT = "drum_radius,joints.elbow.reference_angle,rho"
SETTINGS = Settings(channels=("tension/*/[128]", "effort/*"), coarse=True)
DRAWS = int(os.environ.get("CDRJ_DRAWS", "8"))
RHO = 0.03


@pytest.fixture(scope="module")
def fresh():
    """The prototype with drag, none of whose numbers has been measured."""
    whole = load_document(PROTOTYPE)[0]
    document = {key: value for key, value in whole.items() if key != "uncertainty"}
    drag = [f"cables.{c}.nodes.{k}.bearing_torque" for c in ("upper", "lower") for k in range(2, 9)]
    return with_numbers(document, dict.fromkeys(drag, 0.012))


def drawn(document, *, others):
    """True numbers: the fitted ones, and all others if wanted, evenly over their tolerances."""
    unknowns = parse_unknowns(document, FIT)
    tolerances = [one.factor for one in default_tolerances(document)]
    fitted = {path for unknown in unknowns for path in unknown.paths}
    from scipy.stats import norm, qmc

    table = norm.ppf(
        qmc.LatinHypercube(len(tolerances) + 2, seed=np.random.default_rng(1)).random(DRAWS)
    )
    truths = []
    for row in table:
        values = {}
        for factor, x in zip(tolerances, row, strict=False):
            for path, stddev in factor.items():
                if others or path in fitted:
                    values[path] = number_at(document, path) + float(x) * stddev
                    if path.endswith("bearing_torque"):
                        values[path] = max(values[path], 0.0)
        values.pop("friction.rho", None)
        for cable, x in zip(("upper", "lower"), row[-2:], strict=True):
            values[f"cables.{cable}.friction.rho"] = 0.2 + RHO * float(x)
        truths.append(values)
    return truths


def deviations(document, truths, cells):
    """(found - true) / standard error, shape (draws, numbers)."""
    unknowns = parse_unknowns(document, FIT)
    rows = []
    for seed, values in enumerate(truths):
        real = with_numbers(document, values)
        recorded = recording(real, 4.0, seed=seed, frequency=0.5, amplitude=0.5, cells=cells)
        found = identify(document, "test", unknowns, [recorded], SETTINGS)
        true = [number_at(real, unknown.paths[0]) for unknown in unknowns]
        rows.append((found.values - true) / found.stddev)
    return np.array(rows)


def test_errors_of_a_file_whose_other_numbers_are_wrong_are_as_large_as_claimed(fresh):
    z = deviations(fresh, drawn(fresh, others=True), cells=8)
    beyond = np.mean(np.abs(z) > 2.0)
    print(f"root mean square {np.sqrt(np.mean(z**2)):.2f}, beyond 2: {beyond:.0%}")  # noqa: T201
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.4
    assert np.mean(np.abs(z) > 3.0) < 0.05
    each = np.sqrt(np.mean(z**2, axis=0))
    assert np.all((each > 0.3) & (each < 2.0)), each


def test_a_file_that_says_that_all_others_are_exact_is_believed(fresh):
    exact = {**fresh, "uncertainty": {"others": "exact"}}
    truths = drawn(fresh, others=False)
    z = deviations(exact, truths[:4], cells=1)
    assert np.sqrt(np.mean(z**2)) < 1.6
    claimed = [
        identify(
            document, "test", parse_unknowns(document, FIT),
            [recording(with_numbers(document, truths[0]), 4.0, frequency=0.5, amplitude=0.5)],
            SETTINGS,
        ).stddev
        for document in (fresh, exact)
    ]  # fmt: skip
    assert np.all(claimed[0] > 3.0 * claimed[1])


def test_causes_are_independent_and_leave_out_what_is_fitted(fresh):
    known = build_robot(fresh, "test").uncertainty
    causes = nuisance_causes(known, parse_unknowns(fresh, FIT + ",preload,EA"))
    named = [set(cause) for cause in causes]
    assert {"friction.mu_c", "friction.mu_s"} in named, "they deviate together"
    assert not any("preload" in path or "stiffness" in path.split(".") for c in named for path in c)
    paths = [path for cause in named for path in cause]
    assert len(paths) == len(set(paths))
    together = next(cause for cause in causes if "friction.mu_c" in cause)
    assert together["friction.mu_c"] == pytest.approx(HANDBOOK_FRICTION * 0.15)
    radii = next(cause for cause in causes if "cables.upper.nodes.2.radius" in cause)
    assert radii["cables.upper.nodes.2.radius"] == pytest.approx(DRAWN_RADIUS)


def test_stated_correlations_give_causes_with_the_same_covariance(fresh):
    paths = ["cables.upper.preload", "cables.lower.preload", "cables.upper.axial_stiffness"]
    stated = {
        "parameters": paths, "stddev": [1.0, 0.5, 60.0],
        "correlation": [[1.0, 0.6, 0.2], [0.6, 1.0, 0.0], [0.2, 0.0, 1.0]], "others": "exact",
    }  # fmt: skip
    known = build_robot({**fresh, "uncertainty": stated}, "test").uncertainty
    causes = nuisance_causes(known, parse_unknowns(fresh, "rho"))
    root = np.array([[cause.get(path, 0.0) for cause in causes] for path in paths])
    np.testing.assert_allclose(root @ root.T, known.covariance, rtol=1e-9, atol=1e-12)
    rest = nuisance_causes(known, parse_unknowns(fresh, "EA"))
    assert {path for cause in rest for path in cause} == set(paths[:2])


def test_a_cause_has_only_the_numbers_that_it_moves(fresh):
    """Numbers that a spring scale has read: a direction of their covariance leaves one alone."""
    paths = ["cables.upper.preload", "cables.lower.preload", "cables.upper.axial_stiffness"]
    stated = {
        "parameters": paths, "stddev": [1.21, 1.21, 0.585], "others": "exact",
        "correlation": np.where(np.eye(3) > 0.0, 1.0, 0.95062).tolist(),
    }  # fmt: skip
    known = build_robot({**fresh, "uncertainty": stated}, "test").uncertainty
    causes = nuisance_causes(known, ())
    assert len(causes) == 3
    assert all(all(cause.values()) for cause in causes)
    assert len(unknown_causes(fresh, causes)) == 3


SIZE, STATES = 8000, 8


def linear(residuals, slopes):
    q = slopes.shape[1]
    return Linear(slopes, residuals, np.full(q, 1e-9), np.zeros(q))


def cyclic():
    """Phase of four cycles, the states visited in them, and finer ones."""
    phase = np.arange(SIZE) * 4.0 * 2.0 * np.pi / SIZE
    share = (phase % (2.0 * np.pi)) / (2.0 * np.pi)
    states = (share * STATES).astype(np.int64)
    return phase, Places(states, (share * 4 * STATES).astype(np.int64), STATES)


def test_white_residuals_have_their_own_variance():
    phase, places = cyclic()
    slopes = np.column_stack([np.sin(phase), np.cos(phase), np.ones(SIZE)])
    found = [
        residual_variance(
            linear(np.random.default_rng(k).normal(0.0, 0.3, SIZE), slopes), places, 1.0, 0.0
        )
        for k in range(10)
    ]
    assert np.mean(found) == pytest.approx(0.09, rel=0.5)


def test_noise_that_moves_no_number_by_chance_counts_as_noise_all_the_same():
    phase, places = cyclic()
    slopes = np.sin(phase)[:, None]
    noise = np.random.default_rng(3).normal(0.0, 0.3, SIZE)
    for state in range(STATES):
        here = places.states == state
        noise[here] -= slopes[here, 0] * (slopes[here, 0] @ noise[here]) / np.sum(slopes[here] ** 2)
    assert residual_variance(linear(noise, slopes), places, 1.0, 0.0) < 0.01
    assert residual_variance(linear(noise, slopes), places, 1.0, 0.09) >= 0.09


def test_an_error_that_lasts_in_every_state_counts_once_per_state():
    _, places = cyclic()
    error = np.random.default_rng(1).normal(0.0, 0.2, STATES)[places.states]
    found = residual_variance(linear(error, np.ones((SIZE, 1))), places, 1.0, 0.0)
    power = float(np.var(error))
    assert lasting_variance(error - error.mean(), places.cells) == pytest.approx(power, rel=0.01)
    assert found > power * SIZE / STATES


def test_what_other_numbers_explain_is_not_counted_again():
    phase, places = cyclic()
    noise = np.random.default_rng(2).normal(0.0, 0.01, SIZE)
    cause = np.sign(np.sin(phase))
    slopes = np.column_stack([np.sin(phase), cause])
    explained = residual_variance(linear(noise + 0.5 * cause, slopes), places, 1.0, 0.0)
    assert explained < 3e-4
    alone = linear(noise + 0.5 * cause, slopes[:, :1])
    assert residual_variance(alone, places, 1.0, 0.0) > 1.0


def test_errors_of_fitted_numbers_go_with_those_left_alone_as_stated(fresh):
    unknowns = parse_unknowns(fresh, FIT)
    arms = [f"cables.{c}.spans.{k}.sine" for c in ("upper", "lower") for k in (6, 7)]
    size = {path: 0.3 * DRAWN_RADIUS * np.sign(number_at(fresh, path)) for path in arms}
    real = with_numbers(fresh, {path: number_at(fresh, path) - size[path] for path in arms})
    right, wrong = (
        identify(
            fresh, "test", unknowns, [recording(one, 4.0, frequency=0.5, amplitude=0.5)], SETTINGS
        )
        for one in (fresh, real)
    )
    column = right.others.paths.index(arms[0])
    assert right.others.stddev[column] == pytest.approx(DRAWN_RADIUS)
    expected = 0.3 * np.sign(size[arms[0]]) * right.others.with_fitted[:, column] * right.stddev
    moved = wrong.values - right.values
    assert np.abs(moved[0]) > 1e-5, "the drum's radius takes up the error"
    off = (moved - expected) / right.stddev
    assert np.abs(off).max() < 0.1 * np.abs(moved / right.stddev).max(), off
    others = right.others
    together = np.block(
        [[right.correlation, others.with_fitted], [others.with_fitted.T, others.correlation]]
    )
    assert np.linalg.eigvalsh(together)[0] > -1e-9, "a covariance"
