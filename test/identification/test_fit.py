"""Identification on synthetic recordings: its results, and its findings on undetermined numbers."""

from dataclasses import replace

import numpy as np
import pytest
from support.made_up import recording
from support.places import PROTOTYPE

from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import (
    parse_unknowns,
    starting_values,
    with_bounds,
    with_priors,
)
from cdrj_ros.robot.parameters import number_at, with_numbers
from cdrj_ros.robot.reader import load_document

QUICK = Settings(coarse=True)


@pytest.fixture(scope="module")
def document():
    return load_document(PROTOTYPE)[0]


def found_from(document, fit, start, recordings, settings=QUICK):
    begin = with_numbers(document, start)
    return identify(begin, "test", parse_unknowns(begin, fit), recordings, settings)


def test_a_model_without_error_is_found_again_within_its_standard_errors(document):
    start = {
        **starting_values(document, ["rho=0.24", "axial_stiffness=5027"]),
        "cables.upper.preload": 29.5,
        "cables.lower.preload": 31.5,
    }
    found = found_from(document, "rho,preload,axial_stiffness", start, [recording(document)])
    truth = [number_at(document, unknown.paths[0]) for unknown in found.unknowns]
    off = (found.values - truth) / found.stddev
    assert np.all(np.abs(off) < 3.0), dict(zip([u.name for u in found.unknowns], off, strict=True))
    assert np.sqrt(np.mean(off**2)) < 2.0
    np.testing.assert_allclose(found.values, truth, rtol=2e-3)
    assert not [text for text in found.findings if "told apart" in text]


def test_the_creep_of_a_rope_is_found_and_that_of_a_short_recording_only_as_a_rate(document):
    """Ten seconds determine a delay of two seconds, but of a delay of 200 s only c / tau."""
    for tau in (2.0, 200.0):
        truth = {"creep_share": 0.1 * tau / 2.0, "creep_time": tau, "axial_stiffness": 6283.0}
        rope = with_numbers(
            document, {f"cables.{c}.{k}": v for c in ("upper", "lower") for k, v in truth.items()}
        )
        start = {
            f"cables.{c}.{key}": factor * truth[key]
            for c in ("upper", "lower")
            for key, factor in (("creep_share", 1.3), ("creep_time", 0.8))
        }
        fit = "cables.*.creep_share,cables.*.creep_time,cables.*.axial_stiffness"
        found = found_from(rope, fit, start, [recording(rope, seconds=10.0)])
        expected = np.array([truth[u.paths[0].rsplit(".", 1)[1]] for u in found.unknowns])
        assert np.all(np.abs((found.values - expected) / found.stddev) < 3.0)
        if tau < 10.0:
            np.testing.assert_allclose(found.values, expected, rtol=0.05)
        else:
            share, time, _ = found.values
            assert share / time == pytest.approx(0.05, rel=0.05)
            assert found.stddev[1] > 0.1 * time


FRICTION_AND_DRUM = {
    "friction.mu_c": 0.12,
    "friction.mu_s": 0.24,
    "friction.stribeck_speed": 0.04,
    "friction.bearing_friction": 0.012,
    "drum_radius": 0.0135,
    "pulley_bearing_torque": 1.6e-3,
}
"""Unknowns and their starting values, which are 20 % off (10 % for the drum's radius)."""


@pytest.fixture(scope="module")
def rubbing(document):
    """The prototype with a drag of 2 N mm in the bearing of every pulley, all else exact."""
    exact = {**document, "uncertainty": {"others": "exact"}}
    return with_numbers(exact, starting_values(document, ["pulley_bearing_torque=2e-3"]))


def far_off(document):
    radii = {f"cables.{cable}.nodes.1.radius": 0.0135 for cable in ("upper", "lower")}
    texts = [f"{name}={value}" for name, value in FRICTION_AND_DRUM.items() if "." in name]
    drag = starting_values(document, ["pulley_bearing_torque=1.6e-3"])
    return starting_values(document, texts) | drag | radii


def test_stribeck_bearings_and_drum_are_found_from_slow_and_fast_motion(rubbing):
    """A fast motion takes the cable past the Stribeck speed, a slow one stays below it."""
    both = [
        recording(rubbing, 20.0, name="slow"),
        recording(rubbing, 10.0, name="fast", seed=2, frequency=0.5),
    ]
    found = found_from(rubbing, ",".join(FRICTION_AND_DRUM), far_off(rubbing), both)
    truth = np.array([number_at(rubbing, unknown.paths[0]) for unknown in found.unknowns])
    off = (found.values - truth) / found.stddev
    assert np.all(np.abs(off) < 3.0), dict(zip([u.name for u in found.unknowns], off, strict=True))
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert np.all(found.stddev < 0.06 * truth), "the standard errors themselves are small"


def test_a_late_clock_is_found(document):
    late = recording(document, 10.0, late_s=0.004, noise=0.005)
    found = found_from(document, "clock_offset", {}, [late])
    assert found.values[0] == pytest.approx(0.004, abs=2e-4)


def test_scale_and_offset_of_a_joint_are_found(document):
    whole = recording(document, 10.0)
    readings = whole.joints["elbow"]
    turned = replace(readings, value=(readings.value - 0.01) / -0.98)
    odd = replace(whole, joints={"elbow": turned})
    start = {"joints.elbow.scale": -1.0}
    found = found_from(document, "joint_offset,joint_scale", start, [odd])
    assert found.values == pytest.approx([0.01, -0.98], abs=2e-4)


def test_two_numbers_that_act_as_one_are_named(document):
    quiet = {**document, "friction": {"mu_c": 0.15, "rho": 0.2}}
    rec = recording(quiet, 10.0, noise=1.0)
    found = found_from(quiet, "friction.rho,cables.*.friction.mu_c", {}, [rec])
    (sentence,) = [text for text in found.findings if "told apart" in text]
    assert "friction.rho" in sentence
    assert "mu_c" in sentence
    assert "product" in sentence
    assert found.stddev[0] / found.values[0] > 0.01


def test_a_number_that_the_data_do_not_depend_on_stays_as_it_was(document):
    """The lower cable's preload, where only the upper cable is referenced."""
    fit = "cables.{*}.preload"
    start = {"cables.upper.preload": 33.0}
    found = found_from(
        document, fit, start, [recording(document, 8.0)],
        Settings(channels=("tension/upper/*",), coarse=True),
    )  # fmt: skip
    assert found.values[0] == pytest.approx(36.85, rel=0.01)
    assert found.values[1] == 26.26, "not moved by a rounding error"
    assert found.stddev[1] == pytest.approx(0.4), "the spread that the file states"
    assert found.silent == (False, True)
    assert found.seen.tolist() == [0]


def test_a_number_without_influence_is_named_and_stays_unknown(document):
    found = found_from(
        document, "friction.rho,joints.elbow.spring_stiffness", {}, [recording(document, 5.0)],
        Settings(channels=("tension/*",), coarse=True),
    )  # fmt: skip
    assert any("spring_stiffness has no influence" in text for text in found.findings)
    silent = found.unknowns[1]
    assert found.stddev[1] == pytest.approx((silent.upper - silent.lower) / np.sqrt(12.0))


def test_a_number_at_its_bound_is_named(document):
    unknowns = with_bounds(parse_unknowns(document, "friction.rho"), {"friction.rho": (0.05, 0.15)})
    begin = with_numbers(document, {"friction.rho": 0.1})
    found = identify(begin, "test", unknowns, [recording(document, 5.0)], QUICK)
    assert found.values[0] == pytest.approx(0.15, abs=1e-3)
    assert any("upper bound" in text for text in found.findings)


def test_a_prior_decides_only_numbers_that_the_data_do_not_determine(document):
    unknowns = with_priors(
        parse_unknowns(document, "friction.rho,joints.elbow.spring_stiffness"),
        {"friction.rho": (0.5, 0.1), "joints.elbow.spring_stiffness": (0.02, 0.005)},
    )
    found = identify(
        document, "test", unknowns, [recording(document, 5.0)],
        Settings(channels=("tension/*",), coarse=True),
    )  # fmt: skip
    assert found.values[0] == pytest.approx(0.2, abs=2e-3)
    assert found.values[1] == pytest.approx(0.02, abs=1e-4)
    assert found.stddev[1] == pytest.approx(0.005, rel=0.01)


def test_outliers_hardly_affect_a_robust_fit(document):
    whole = recording(document, 10.0)
    spoilt = dict(whole.references)
    for channel, series in whole.references.items():
        bad = series.value.copy()
        bad[300:400] += 5.0 * np.ptp(bad)  # a disturbed load cell
        spoilt[channel] = replace(series, value=bad)
    rec = replace(whole, references=spoilt)
    plain = found_from(document, "rho", {"friction.rho": 0.24}, [rec])
    robust = found_from(
        document, "rho", {"friction.rho": 0.24}, [rec], replace(QUICK, loss="huber")
    )
    truth = np.array([0.2, 0.2])
    assert np.abs(plain.values - truth).max() > 5.0 * np.abs(robust.values - truth).max()
    np.testing.assert_allclose(robust.values, truth, atol=4e-3)


def test_tied_numbers_are_one_and_a_minus_turns_the_sign(document):
    (one,) = parse_unknowns(document, "cables.*.preload")
    assert one.paths == ("cables.upper.preload", "cables.lower.preload")
    assert one.start == pytest.approx((36.85 + 26.26) / 2.0)
    text = "cables.upper.spans.6.sine=-cables.lower.spans.6.sine"
    (slope,) = parse_unknowns(document, text)
    assert slope.factors == (1, -1)
    assert slope.start == pytest.approx(-0.06)
    drums = parse_unknowns(document, "drum_radius")
    assert [drum.paths for drum in drums] == [
        ("cables.upper.nodes.1.radius", "cables.lower.nodes.1.radius")
    ]
    assert len(parse_unknowns(document, "rho,EA,v_s,f_d,clock_offset")) == 9


@pytest.mark.parametrize(
    ("fit", "taught"),
    [
        ("roh", "did you mean rho?"),
        ("rho,,preload", "single commas"),
        ("rho,cables.upper.friction.rho", "fitted twice"),
        ("cables.{*}.preload=cables.{*}.max_tension", "use only one"),
        ("-friction.rho", "only after ="),
        ("cables.upper.max_tension2", "did you mean"),
    ],
)
def test_a_wrong_name_is_refused_with_its_remedy(document, fit, taught):
    with pytest.raises(UsageError, match=taught):
        parse_unknowns(document, fit)


@pytest.mark.parametrize(
    ("name", "bounds", "taught"),
    [
        ("rho", (0.5, 0.1), "must be less than"),
        ("preload", (0, 1), "not among the fitted numbers"),
        ("cables.upper.axial_stiffness", (-1, 5), "cannot change its sign"),
    ],
)
def test_wrong_bounds_are_refused_with_the_reason(document, name, bounds, taught):
    unknowns = parse_unknowns(document, "rho,axial_stiffness")
    with pytest.raises(UsageError, match=taught):
        with_bounds(unknowns, {name: bounds})


def test_what_cannot_be_fitted_is_refused_with_a_reason(document):
    rec = recording(document, 5.0)
    with pytest.raises(UsageError, match="no reference is called effort/knee"):
        found_from(document, "rho", {}, [rec], Settings(channels=("effort/knee",)))
    with pytest.raises(UsageError, match="no reference of this robot"):
        found_from(document, "rho", {}, [replace(rec, references={})])
    with pytest.raises(RobotFileError, match="mu_s"):
        found_from(document, "rho", {"friction.mu_c": 0.3}, [rec])
    with pytest.raises(UsageError, match="loss"):
        found_from(document, "rho", {}, [rec], Settings(loss="cauchy"))


def test_the_last_round_takes_every_sample(document):
    rec, start = recording(document, 10.0), {"friction.rho": 0.22}
    rough, full = (
        found_from(document, "friction.rho", start, [rec], Settings(coarse=coarse, samples=500))
        for coarse in (True, False)
    )
    assert rough.samples < full.samples == 2000
    np.testing.assert_allclose(full.values, 0.2, atol=1e-3)
