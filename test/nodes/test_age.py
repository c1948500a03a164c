"""Estimates older than the timeout are STALE, whatever made them old."""

import numpy as np
import pytest
from support.estimators import BEGIN, SECOND, Clock, diagnosed, feed, tensions

from cdrj_ros.messages.cdr import CABLE_TENSIONS, read_layout
from cdrj_ros.model.packing import STALE
from cdrj_ros.nodes.silence import Silence, StampClock

MS = 1_000_000


def _late_s(lags_s, same_clock_s=60.0):
    """How late readings with these lags are found to be [s]; their stamps are 1 s apart."""
    stamps = StampClock(same_clock_s)
    found = []
    for k, lag_s in enumerate(lags_s):
        newest_ns = BEGIN + k * SECOND
        now_ns = newest_ns + round(lag_s * 1e9)
        found.append(stamps.note(newest_ns, now_ns) * 1e-9)
        assert stamps.age_s(newest_ns, now_ns, 0.1, 0.2) == max(found[-1], 0.1 + 0.2)
    return found


def test_a_constant_lag_of_another_clock_is_no_lateness():
    assert _late_s([100.0, 100.0, 100.0]) == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
    assert _late_s([10.0, 10.0], 5.0) == pytest.approx([0.0, 0.0], abs=1e-3)
    assert _late_s([100.0, 100.0], 1e10) == pytest.approx([100.0, 100.0])
    assert _late_s([-5.0, -5.0]) == pytest.approx([-5.0, -5.0]), "stamps ahead are not late"


def test_lateness_that_appears_or_grows_is_lateness_by_any_clock():
    assert _late_s([0.0, 30.0, 59.0, 61.0, 3600.0]) == pytest.approx([0, 30.0, 59.0, 61.0, 3600.0])
    assert _late_s([100.0, 100.0, 102.0, 170.0]) == pytest.approx([0.0, 0.0, 2.0, 70.0], abs=0.1)
    assert _late_s([102.0, 101.0, 100.0, 102.0])[-1] == pytest.approx(2.0, abs=1e-2)


def test_two_clocks_may_drift_apart_by_two_tenths_of_a_millisecond_per_second():
    late = _late_s([100.0 + 1e-4 * k for k in range(3600)])
    assert max(late) < 1e-3
    assert _late_s([100.0 + 1e-2 * k for k in range(3600)])[-1] > 30.0


def test_an_estimate_before_a_simulated_clock_starts_is_no_silence():
    """ROS's time is 0 until the first message on /clock."""
    silence = Silence(0.5, simulated=True)
    silence.note(0, 10.0)
    assert silence.seconds(0, 10.1) == 0.0
    assert silence.seconds(BEGIN, 10.2) == 0.0
    assert silence.seconds(BEGIN + SECOND, 10.3) == 1.0


def test_a_simulated_clock_stands_if_it_has_not_advanced_for_the_timeout():
    silence, system = Silence(0.5, simulated=True), Silence(0.5, simulated=False)
    for one in (silence, system):
        one.seconds(0, 10.0)
        assert not one.clock_stands(10.4)
    assert silence.clock_stands(10.6)
    assert not system.clock_stands(10.6)
    silence.seconds(1, 10.7)
    assert not silence.clock_stands(10.8)


def test_a_clock_that_is_set_back_has_another_offset():
    stamps = StampClock()
    stamps.note(BEGIN, BEGIN + 100 * SECOND)
    assert stamps.note(BEGIN - 3600 * SECOND, BEGIN + 101 * SECOND) == 0


def test_the_node_s_clock_can_be_disregarded():
    assert _late_s([0.0, 100.0, 3600.0], 0.0) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("late_s", "within_s", "stale"),
    [(0.4, 60.0, False), (10.0, 60.0, True), (10.0, 5.0, False), (100.0, 60.0, False),
     (100.0, 3600.0, True)],
)  # fmt: skip
def test_where_all_inputs_are_late_alike_the_estimates_are_stale(late_s, within_s, stale, bench):
    estimator = bench.estimator(use_sim_time=True, timeout=0.5, same_clock_within=within_s)
    status = []
    published = estimator.outputs.tensions.publish

    def publish(payload):
        found = read_layout(payload, CABLE_TENSIONS.fields).numbers["status"]
        status.append(np.frombuffer(payload, found.dtype, found.count, found.offset))
        published(payload)

    estimator.outputs.tensions.publish = publish
    estimator.watch.lost = lambda: False  # the last estimate is not to be published again
    clock = Clock(bench, estimator)
    for k in range(0, 60, 20):
        clock.set(BEGIN + k * MS + round(late_s * 1e9))
        feed(estimator, k, k + 20)
    assert len(status) == len(tensions(estimator)) == 60
    assert all(bool(np.all(one & STALE)) == stale for one in status)
    assert any(bool(np.all(one & STALE)) for one in status) == stale
    if stale:
        assert estimator.watch.health(estimator.latest, 1.0, 0).age_s > 0.5
        (said, *_) = diagnosed(estimator)
        assert said.level != said.OK
