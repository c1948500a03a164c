"""Numbers whose accuracy a robot file does not state have default standard deviations."""

from dataclasses import replace

import numpy as np
import pytest
from support.places import PROTOTYPE, ROBOTS

from cdrj_ros.estimation.changes import narrowed
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.robot.parameters import find_number
from cdrj_ros.robot.reader import load_robot, parse_robot
from cdrj_ros.robot.tolerances import CALLIPER, SPRING_SCALE_NOW, ZERO_BY_EYE
from cdrj_ros.robot.writer import with_section

TEXT = PROTOTYPE.read_text(encoding="utf-8")
FRESH = with_section(TEXT, "uncertainty", None)


EXACT = {
    "winding", "effort_sign", "direction", "cells", "range", "max_speed", "max_tension", "period",
    "slack_tension", "sensor_noise", "resolution", "noise", "tracking_bandwidth", "scale",
    "stribeck_lag", "breakaway",
}  # fmt: skip
"""Keys that are conventions, limits, or properties of the sensors and of the numerical method."""

ELSEWHERE = {
    "offset", "clock_offset", "correction", "wrap_angle", "spans", "bearing_diameter", "diameter",
    "youngs_modulus", "bearing_stiffness", "viscous", "bristle_damping", "angle",
}  # fmt: skip
"""Keys whose error is contained in that of another: docs/estimation.md says in which."""


def stddevs(robot):
    known = robot.uncertainty
    return dict(zip(known.parameters, np.sqrt(np.diag(known.covariance)).tolist(), strict=True))


def numbers(value, path=""):
    """Paths of all numbers of a document except results and zeros."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if key not in ("uncertainty", "identified"):
                yield from numbers(entry, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            name = entry["name"] if isinstance(entry, dict) and "name" in entry else k + 1
            yield from numbers(entry, f"{path}.{name}")
    elif isinstance(value, (int, float)) and value:
        yield path


@pytest.mark.parametrize(
    "name", ["prototype", "prototype_positions", "finger", "hoist", "parallel"]
)
def test_every_number_has_a_standard_deviation_or_a_reason_for_none(name):
    text = with_section((ROBOTS / f"{name}.yaml").read_text("utf-8"), "uncertainty", None)
    robot = parse_robot(text)
    uncertain = stddevs(robot)
    every = list(numbers(robot.document))
    assert len(every) > 20
    for path in every:
        assert path in uncertain or not (EXACT | ELSEWHERE).isdisjoint(path.split(".")), path
    assert all(stddev > 0.0 for stddev in uncertain.values())
    assert all(find_number(dict(robot.document), path) for path in uncertain)


def test_numbers_with_one_cause_deviate_together():
    known = parse_robot(FRESH).uncertainty
    i, j = (known.parameters.index(f"cables.{c}.nodes.1.radius") for c in ("upper", "lower"))
    assert known.covariance[i, j] == pytest.approx(known.covariance[i, i])
    i, j = (known.parameters.index(f"cables.{c}.spans.6.sine") for c in ("upper", "lower"))
    assert known.covariance[i, j] == pytest.approx(-known.covariance[i, i])


def test_a_stated_standard_deviation_replaces_the_default():
    stated = "uncertainty:\n  parameters: [cables.upper.preload]\n  stddev: [0.25]\n"
    known = parse_robot(with_section(FRESH, "uncertainty", stated)).uncertainty
    assert known.stated == 1
    assert known.parameters.count("cables.upper.preload") == 1
    assert known.covariance[0, 0] == pytest.approx(0.25**2)
    assert np.all(known.covariance[0, 1:] == 0.0)
    assert "cables.lower.preload" in known.parameters
    assert known.may_slip == ("upper", "lower")


def test_a_static_coefficient_stays_above_a_stated_coulomb_coefficient():
    stated = "uncertainty:\n  parameters: [friction.mu_c]\n  stddev: [0.01]\n"
    assert "friction.mu_s" not in stddevs(parse_robot(with_section(FRESH, "uncertainty", stated)))


@pytest.mark.parametrize(
    ("stated", "slips"),
    [
        ("drums: hold", ()),
        ("drums: {upper: hold}", ("lower",)),
        ("{others: exact, drums: {lower: may_slip}}", ("lower",)),
    ],
)
def test_drums_may_slip_unless_the_file_says_of_them_that_they_hold(stated, slips):
    known = parse_robot(with_section(FRESH, "uncertainty", f"uncertainty:\n  {stated}")).uncertainty
    assert known.may_slip == slips


@pytest.mark.parametrize(
    ("drums", "said"),
    [
        ("{outer: hold}", "uncertainty.drums has no cable 'outer'; on drums are lower, upper"),
        ("{upper: yes}", "uncertainty.drums.upper must be one of hold, may_slip"),
        ("held", "uncertainty.drums must be one of hold, may_slip"),
    ],
)
def test_what_drums_may_do_is_refused_by_key(drums, said):
    with pytest.raises(RobotFileError, match=said):
        parse_robot(with_section(FRESH, "uncertainty", f"uncertainty:\n  drums: {drums}"))


@pytest.mark.parametrize("stated", ["", "\n  parameters: [friction.rho]\n  stddev: [0.01]"])
def test_others_may_be_exact(stated):
    text = with_section(FRESH, "uncertainty", f"uncertainty:\n  others: exact{stated}")
    known = parse_robot(text).uncertainty
    assert (known is None) == (not stated)
    if known is not None:
        assert known.parameters == ("friction.rho",)
        assert not known.may_slip


def test_the_models_error_names_channels_of_the_robot():
    text = with_section(FRESH, "uncertainty", "uncertainty:\n  model_error: {effort/winch: 0.01}")
    known = parse_robot(text).uncertainty
    assert known.model_error == (("effort/winch", 0.01),)
    with pytest.raises(RobotFileError, match=r"effort/wench.*effort/winch"):
        parse_robot(text.replace("effort/winch", "effort/wench"))


def test_a_tare_leaves_the_error_of_the_encoder_and_measured_numbers_are_known_better():
    robot = parse_robot(FRESH)
    zero, reference = "joints.elbow.offset", "joints.elbow.reference_angle"
    drums = [f"cables.{name}.nodes.1.radius" for name in ("upper", "lower")]
    changed = {reference: 0.1, "cables.lower.preload": 30.0, **dict.fromkeys(drums, 0.0151)}
    before, known = stddevs(robot), narrowed(robot, changed)
    both = [known.parameters.index(path) for path in (zero, reference)]
    error = known.covariance[np.ix_(both, both)]
    np.testing.assert_allclose(error, ZERO_BY_EYE**2, err_msg="the encoder's error is that of both")
    both = [known.parameters.index(path) for path in drums]
    error = known.covariance[np.ix_(both, both)]
    np.testing.assert_allclose(error, CALLIPER**2, err_msg="the drums of one motor err together")
    after = stddevs(replace(robot, uncertainty=known))
    assert after["cables.lower.preload"] == pytest.approx(min(SPRING_SCALE_NOW * 30.0, 2.626))
    assert {p: s for p, s in after.items() if p not in changed} == pytest.approx(
        {p: s for p, s in before.items() if p not in changed}
    )


def test_a_measurement_never_widens_what_the_file_states():
    robot = load_robot(PROTOTYPE)
    known = narrowed(robot, {"cables.upper.preload": 36.0})
    assert stddevs(replace(robot, uncertainty=known))["cables.upper.preload"] == pytest.approx(0.4)
