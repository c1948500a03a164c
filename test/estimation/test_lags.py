"""Values that are older than their stamp: seen where motion shows them, uncertain elsewhere."""

from __future__ import annotations

import pytest
from support.campaign import MS, Course, Faults, Verdict, course_of, judge, run, sine

from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.prepared import Model


@pytest.fixture(scope="module")
def course(model: Model) -> Course:
    """A load that the winch balances, with the friction of 16 cells per pulley."""
    return course_of(model, 8.0, sine(0.25, 0.4), load=0.2, seed=4)


def _run(model: Model, course: Course, older_ms: int) -> tuple[Verdict, Vector]:
    """The verdict, and mean and standard deviation of the joint's lag [s]."""
    faults = Faults(period_ns={"winch": 5 * MS, "elbow": 5 * MS}, older_ns={"elbow": older_ms * MS})
    lags: list[Vector] = []

    def watch(live: LiveEstimator) -> None:
        assert live.ensemble is not None
        lags.append(live.ensemble.core.lag[:, 1])

    outputs = run(model, course, faults, watch=watch)
    return judge(course, outputs), lags[0]


@pytest.mark.parametrize("older_ms", [-10, 5, 20, 30])
def test_no_wrong_tension_has_status_0_where_values_are_older_than_their_stamp(
    model: Model, course: Course, older_ms: int
) -> None:
    verdict, (mean, stddev) = _run(model, course, older_ms)
    assert verdict.beyond(5.0) <= 0.001
    assert abs(abs(mean) - 1e-3 * abs(older_ms)) < 5e-3
    assert 0.0 < stddev < 5e-3


def test_what_motion_excludes_takes_no_status_0(model: Model, course: Course) -> None:
    verdict, (mean, stddev) = _run(model, course, 0)
    assert abs(mean) < 4e-3
    assert stddev < 5e-3
    assert verdict.ratio.size > 0.85 * verdict.judged
