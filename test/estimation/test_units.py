"""Units, signs and factors of angles, by what cables say of them, (C15), in small cases."""

import numpy as np
import pytest

from cdrj_ros.estimation.model_error import load_share
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.packing import UNSURE
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot

START = 1_700_000_000_000_000_000
MS = 1_000_000
TEXT = """
name: pair
motors: [{name: m}]
joints: [{name: q, range: [-3, 3]}]
cables:
  - name: c
    axial_stiffness: 1000
    preload: 10
    max_tension: 100
    nodes: [{type: winch, motor: m, winding: -1, radius: 0.1}, {type: anchor}]
    spans: [[1, {joint: q, slope: 0.1}]]
  - name: d
    axial_stiffness: 1000
    preload: 10
    max_tension: 100
    nodes: [{type: winch, motor: m, winding: 1, radius: 0.1}, {type: anchor}]
    spans: [[1, {joint: q, slope: -0.1}]]
uncertainty: {others: exact}
"""
"""Both cables take 100 N/rad of both axes; 6 rad of the joint would take 600 N of 100 N."""
SHARE = 100.0 / 600.0


class Moved:
    """An estimator whose axes have moved together, with readings 10 mrad of true angle apart."""

    def __init__(self, text=TEXT):
        self.live = LiveEstimator(prepare(parse_robot(text)))
        self.at_ns = START
        self.unsure = []
        """Whether a tension is, sample by sample,"""
        self.doubted = []
        """and whether a unit is in doubt."""

    def feed(self, **angles):
        names, positions = tuple(angles), tuple(angles.values())
        for found in self.live.feed("both", self.at_ns, names, positions)[1]:
            self.unsure.append(bool((found.status.astype(int) & UNSURE).any()))
        self.doubted.append(bool(self.live.misfitting))
        self.at_ns += 10 * MS
        return self

    def together(self, motor, joint, until=1.0):
        for k in range(round(100 * until)):
            self.feed(m=motor(0.01 * k), q=joint(0.01 * k))
        return self


def same(angle):
    return angle


@pytest.mark.parametrize("factor", [-1.0, 0.0, 0.1, 0.5, 0.65, 0.8, 1.25, 1.6, 2.0, 57.3])
@pytest.mark.parametrize("of_motor", [True, False])
def test_an_axis_of_another_unit_is_unsure_once_it_is_worth_a_tenth(factor, of_motor):
    def wrong(angle):
        return factor * angle

    axes = (wrong, same) if of_motor else (same, wrong)
    moved = Moved().together(*axes, until=0.05 if factor > 50.0 else 1.0)
    first = moved.unsure.index(True, 1)
    assert all(moved.unsure[first:])
    assert abs(factor - 1.0) * (first - 1) <= 1.0 + 1e-6, "every step is worth a tenth"
    assert moved.live.misfitting == ["m", "q"], "nothing tells which"


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_a_load_in_proportion_that_the_range_allows_is_no_other_unit(factor):
    assert abs(factor - 1.0) < 0.9 * SHARE
    moved = Moved().together(same, lambda angle: factor * angle)
    assert not any(moved.doubted)


def test_a_doubt_ends_when_the_axes_have_moved_so_far_that_a_load_explains_the_stretch():
    """The motor has wound in 20 mrad while the joint stood; a load does so after 120 mrad."""
    moved = Moved().together(same, lambda angle: max(angle - 0.02, 0.0))
    last = max(k for k, is_doubted in enumerate(moved.doubted) if is_doubted)
    assert 0.01 * last - 0.02 == pytest.approx(0.02 / SHARE, abs=0.0101)
    assert all(moved.doubted[2 : last + 1])
    assert all(moved.unsure[2 : last + 1])


def test_loads_are_believed_as_far_as_they_would_not_be_too_much_at_the_ends_of_the_range():
    """After 1 rad of 6 a load of 16 of 100 N is one."""
    moved = Moved().together(same, same)
    for k in range(190):
        moved.feed(m=0.99 + 0.001 * k, q=0.99)
    first = moved.doubted.index(True) - 100
    assert 0.1 * first == pytest.approx(99.0 * SHARE, abs=2.0), "[N]"


def test_a_cable_that_an_axis_hardly_moves_says_little_of_its_unit():
    """Cable c stretches by 50 N; it has a millionth of the arm about p, which moves e alone."""
    more = """
  - name: e
    axial_stiffness: 1000
    preload: 10
    max_tension: 100
    nodes: [{type: winch, motor: n, winding: -1, radius: 0.1}, {type: anchor}]
    spans: [[1, {joint: p, slope: 0.1}]]
uncertainty:"""
    text = TEXT.replace("[{name: m}]", "[{name: m}, {name: n}]").replace("\nuncertainty:", more)
    text = text.replace("[-3, 3]}]", "[-3, 3]}, {name: p, range: [-3, 3]}]")
    text = text.replace("slope: 0.1}]]", "slope: 0.1}, {joint: p, slope: 1e-7}]]", 1)
    moved = Moved(text)
    for k in range(100):
        moved.feed(m=0.01 * k, q=0.005 * k, n=0.01 * k, p=0.01 * k)
    _, found = moved.live.feed("both", moved.at_ns, ("m", "q", "n", "p"), (1.0, 0.5, 1.0, 1.0))
    assert moved.live.misfitting
    assert found[-1].stddev[2] < 50.0, "[N], of e"


def test_a_doubt_outlasts_a_gap_and_ends_with_a_reset():
    """In the gap the axes move on, which leaves friction unknown, but not what a tension was."""
    moved = Moved().together(same, lambda angle: 0.5 * angle, until=0.5)
    moved.at_ns += 2_000 * MS
    for k in range(20):
        moved.feed(m=0.6 + 0.01 * k, q=0.3 + 0.005 * k)
    assert all(moved.unsure[-10:])
    moved.live.reset()
    assert moved.live.misfitting == []


@pytest.mark.parametrize("followed", [True, False])
def test_a_joint_that_the_cables_let_go_through_its_range_leaves_no_doubt(followed):
    """0.8 rad of a joint are worth 80 of 100 N: the motor takes them up, or the cable does."""
    free = "{name: q, range: [-3, 3]}, {name: f, range: [-0.4, 0.4]}"
    text = TEXT.replace("{name: q, range: [-3, 3]}", free)
    text = text.replace("slope: 0.1}", "slope: 0.1}, {joint: f, slope: 0.1}")
    moved = Moved(text.replace("slope: -0.1}", "slope: -0.1}, {joint: f, slope: -0.1}"))
    for k in range(40):
        taken_up = 0.01 * k if followed else 0.0
        moved.feed(f=0.01 * k, m=taken_up, q=0.001 * k if followed else 0.0)
    assert not any(moved.doubted)


def test_what_a_load_may_stretch_follows_from_tensions_and_ranges():
    model = prepare(parse_robot(TEXT))
    assert load_share(model) == pytest.approx(np.array([[0.0, SHARE], [0.0, SHARE]]))
    unlimited = prepare(parse_robot(TEXT.replace("    max_tension: 100\n", "")))
    assert load_share(unlimited)[0, 1] == pytest.approx(40.0 / 600.0), "four preloads"
