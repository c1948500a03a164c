"""Values that are older than their stamp: seen where motion shows them, uncertain elsewhere."""

from math import exp, hypot, pi, sin, sqrt

import pytest
from support.campaign import MS, START, Faults, course_of, judge, run, sine

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot


@pytest.fixture(scope="module")
def course(model):
    """A load that the winch balances, with the friction of 16 cells per pulley."""
    return course_of(model, 8.0, sine(0.25, 0.4), load=0.2, seed=4)


def _run(model, course, older_ms):
    """The verdict, and mean and standard deviation of the joint's lag [s]."""
    faults = Faults(period_ns={"winch": 5 * MS, "elbow": 5 * MS}, older_ns={"elbow": older_ms * MS})
    lags = []

    def watch(live):
        lags.append(live.ensemble.core.lag[:, 1])

    outputs = run(model, course, faults, watch=watch)
    return judge(course, outputs), lags[0]


@pytest.mark.parametrize("older_ms", [-10, 5, 20, 30])
def test_no_wrong_tension_has_status_0_where_values_are_older_than_their_stamp(
    model, course, older_ms
):
    verdict, (mean, stddev) = _run(model, course, older_ms)
    assert verdict.beyond(5.0) <= 0.001
    assert abs(abs(mean) - 1e-3 * abs(older_ms)) < 5e-3
    assert 0.0 < stddev < 5e-3


def test_what_motion_excludes_takes_no_status_0(model, course):
    verdict, (mean, stddev) = _run(model, course, 0)
    assert abs(mean) < 4e-3
    assert stddev < 5e-3
    assert verdict.ratio.size > 0.83 * verdict.judged


# --- in cases computed by hand --------------------------------------------------------------------

PAIR = """
name: pair
motors: [{name: m}]
joints: [{name: q, range: [-3, 3]}]
friction: {law: none, bearing_friction: 0.0, mu_c: 0.0}
cables:
  - name: c
    axial_stiffness: 1000
    preload: 100
    nodes: [{type: winch, motor: m, winding: -1, radius: 0.1}, {type: anchor}]
    spans: [[1, {joint: q, slope: 0.1}]]
uncertainty:
  others: exact
  parameters: [motors.m.clock_offset, joints.q.clock_offset]
  stddev: [0.00509, 0.01227]
"""
"""The cable takes 100 N/rad of both axes, whose lags are known to 5 and 12 ms (rounded up)."""


def _pair(angles, text=PAIR):
    """Motor and joint, 10 ms apart; the estimator and its last estimate."""
    live, found = LiveEstimator(prepare(parse_robot(text))), list[Estimate]()
    for k, pair in enumerate(angles):
        found += live.feed("both", START + 10 * k * MS, ("m", "q"), pair)[1]
    return live, found[-1]


def test_at_rest_an_axis_lags_the_first_one_as_far_as_both_clocks_allow():
    live, _ = _pair((0.0, 0.0) for _ in range(20))
    assert live.ensemble.core.lag[1, 1] == pytest.approx(hypot(5.09e-3, 12.27e-3), rel=2e-3)


def test_a_tension_that_follows_a_motion_exactly_shows_the_lag_as_five_errors_of_2_percent_do():
    """In 80 mrad friction has not reversed: no other term of the fit has the velocity's phase."""
    seconds, hertz, amplitude, gain, tension = 4.0, 1.0, 0.08, 100.0, 100.0
    angles = [amplitude * sin(2.0 * pi * hertz * 0.01 * k) for k in range(round(100 * seconds))]
    live, _ = _pair(zip(angles, angles, strict=True))
    fastest = gain * amplitude * 2.0 * pi * hertz
    forgets = 10.0 / (2.0 / pi)  # the mean of |cos| is 2 / pi, that of |cos|^3 is 4 / (3 pi)
    lasting = forgets * (1.0 - exp(-seconds / forgets))
    weight = 2.0 / pi * lasting / 0.1
    variance = 5.0 * (0.02 * tension) ** 2 / (weight + 5.0)
    squares = 4.0 / (3.0 * pi) * fastest**2 * lasting / 0.1
    first = 1.0 / hypot(5.09e-3, 12.27e-3) ** 2
    expected = 1.0 / sqrt(squares / variance + first)
    assert live.ensemble.core.lag[:, 1] == pytest.approx((0.0, expected), rel=0.03, abs=1e-4)


def test_elements_that_lags_make_uncertain_are_named_until_the_accuracy_of_clocks_is_stated():
    """A grip that changes as fast as the pose hides how old the values are."""
    swings = [0.3 * sin(2.0 * pi * 0.01 * k) for k in range(400)]
    grips = [0.02 * sin(2.0 * pi * 0.013 * k + 1.0) for k in range(400)]
    angles = [(swing - grip, swing) for swing, grip in zip(swings, grips, strict=True)]
    stated = ("parameters: [motors.m.clock_offset, joints.q.clock_offset]", "[0.00509, 0.01227]")
    unknown = PAIR.replace(f"  {stated[0]}\n  stddev: {stated[1]}\n", "")
    known = PAIR.replace(stated[1], "[1.0e-4, 1.0e-4]")
    found = [_pair(angles, text) for text in (unknown, known)]
    assert [live.late_elements(last) for live, last in found] == [["c/1"], []]
    variances = [last.stddev[0] ** 2 for _, last in found]
    late = [live.ensemble.core.late[0] for live, _ in found]
    assert late[0] - late[1] == pytest.approx(variances[0] - variances[1], rel=1e-3)


def test_a_sudden_change_of_the_mean_tension_leaves_it_in_doubt_for_80_ms():
    """The motor winds in 50 mrad within 50 ms, 1.1 N per reading; three of these exceed 2.4 N."""
    live = LiveEstimator(prepare(parse_robot(PAIR.replace("0.00509, 0.01227", "1.0e-4, 1.0e-4"))))
    found = list[Estimate]()
    for k in range(250):
        angle = 0.3 * sin(2.0 * pi * 0.01 * k)
        wound = 0.01 * min(max(k - 200, 0), 5)
        found += live.feed("both", START + 10 * k * MS, ("m", "q"), (angle - wound, angle))[1]
    assert [k for k, one in enumerate(found[1:], 1) if one.status[0]] == [*range(203, 205 + 9)]
    assert [one.stddev[0] for one in found[200:]] == pytest.approx([0.8] * 50, rel=0.02)


def test_a_lag_is_worth_six_tenths_of_what_the_mean_tension_has_swung_at_most():
    """The motor winds in 5 mrad after a motion of both at 1 rad/s, in which a lag is worth more."""
    moved = [(-0.01 * k, -0.01 * k) for k in range(100)]
    loaded = [(-0.99 - 2e-4 * k, -0.99) for k in range(1, 26)]
    _, found = _pair([*moved, *loaded])
    swung = float(found.tension[0]) - 100.0
    assert 0.5 < swung < 0.7, "5 mrad, with a cable that is a tenth shorter"
    assert found.stddev[0] == pytest.approx(0.6 * swung, rel=0.02)
