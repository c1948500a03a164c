"""A trusted sensor that suddenly reads otherwise: a fault of it or a change of preload."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import pytest
from support.campaign import (
    CELL,
    EFFORT,
    MS,
    SECOND,
    START,
    Course,
    Faults,
    How,
    Lie,
    course_of,
    judge,
    quarter_rate,
    run,
    sine,
)

from cdrj_ros.estimation import estimator
from cdrj_ros.estimation.changes import with_other_numbers
from cdrj_ros.estimation.draws import standard
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.estimation.innovation_gate import LASTING, PreloadEvidence, SensorState
from cdrj_ros.estimation.lasting_error import CELL as CELL_ERRORS
from cdrj_ros.estimation.lasting_error import LastingError
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.model.packing import UNSURE
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.parameters import number_at

SELDOM: Final = 20 * MS
"""Interval of a load cell's readings [ns]: correcting takes most of the time of these tests."""
CHANGE: Final = -4.0
"""[N]."""


@pytest.fixture(scope="module")
def course(model: Model) -> Course:
    return course_of(model, 8.0, sine(0.3, 0.45))


@pytest.fixture(scope="module")
def longer(model: Model) -> Course:
    return course_of(model, 12.0, sine(0.3, 0.45))


@pytest.fixture(scope="module")
def slow(model: Model) -> Course:
    return course_of(model, 18.0, sine(0.1))


def _assert_law(model: Model, course: Course, faults: Faults) -> None:
    """The liar is trusted before, and leaves no wrong tension with status 0 afterwards."""
    begin = faults.lies[CELL].since_ns
    outputs = run(model, course, faults)
    before = judge(course, outputs, begin - SECOND, begin)
    verdict = judge(course, outputs, begin, course.duration_ns)
    assert before.ratio.size >= (0.99 if EFFORT in faults.sensors else 0.49) * before.judged
    assert before.beyond(2.0) == 0.0
    assert verdict.judged > 0
    assert verdict.beyond(5.0) <= 0.001
    assert verdict.beyond(2.0) <= 0.08


@pytest.mark.parametrize(
    ("how", "size", "sensors"),
    [
        ("drifts", 1.0, (CELL, EFFORT)),
        ("drifts", -1.0, (CELL,)),
        ("drifts", 0.3, (CELL, EFFORT)),
        ("is off", 1.0, (CELL,)),
        ("is off", -5.0, (CELL, EFFORT)),
    ],
)
def test_a_trusted_cell_that_drifts_or_is_off_keeps_to_the_law(
    how: How, size: float, sensors: tuple[str, ...], model: Model, longer: Course
) -> None:
    """An effort beside it is right."""
    lies = {CELL: Lie(how, 6 * SECOND, size)}
    faults = Faults(quarter_rate(), sensors=sensors, lies=lies, cell_ns=SELDOM)
    _assert_law(model, longer, faults)


@pytest.mark.parametrize(
    ("since_ns", "effort", "beside"),
    [(7 * SECOND, -0.0136, {}), (5 * SECOND, 0.003, {CELL: Lie("is off", 3 * SECOND, 9.7)})],
    ids=["alone", "beside a cell"],
)
def test_an_effort_that_gets_stuck_is_not_taken_for_lost_preloads(
    since_ns: int, effort: float, beside: dict[str, Lie], model: Model, longer: Course
) -> None:
    """It does not follow the uncorrected estimate, also after a cell that was wrong as well."""
    lies = {EFFORT: Lie("is stuck", since_ns, effort), **beside}

    def watch(live: LiveEstimator) -> None:
        assert live.fusion is not None
        assert live.fusion.sensors.faults().keys() == lies.keys()

    outputs = run(
        model, longer, Faults(quarter_rate(), sensors=tuple(lies), lies=lies), watch=watch
    )
    assert judge(longer, outputs, SECOND, since_ns).ratio.size > 0
    assert judge(longer, outputs, since_ns, longer.duration_ns).beyond(5.0) <= 0.001
    assert abs(outputs[-1].tension - longer.tension[-1]).max() < 1.0


def test_an_effort_that_takes_both_preloads_along_keeps_to_the_law(model: Model) -> None:
    """Stuck at one half of the hysteresis, it agrees every other stroke: both preloads fall."""
    fast = course_of(model, 9.0, sine(1.9), seed=8)
    lies = {EFFORT: Lie("is stuck", 6244 * MS, -0.045)}
    verdict = judge(
        fast, run(model, fast, Faults(sensors=(EFFORT,), lies=lies)), 0, fast.duration_ns
    )
    assert verdict.ratio.size >= 0.3 * verdict.judged
    assert verdict.beyond(5.0) <= 0.001


@pytest.mark.parametrize(
    ("name", "lie", "sensors", "least"),
    [
        (EFFORT, Lie("drifts", 0, 0.01), (CELL, EFFORT), 0.2),
        (EFFORT, Lie("drifts", 0, 0.02), (EFFORT,), 0.05),
        (EFFORT, Lie("is off", 0, 0.114), (CELL, EFFORT), 0.2),
        (CELL, Lie("scales", 0, -0.1), (CELL,), 0.2),
        (CELL, Lie("scales", 0, -0.27), (CELL,), 0.0),
    ],
)
def test_a_sensor_whose_bias_or_gain_is_wrong_keeps_to_the_law(
    name: str, lie: Lie, sensors: tuple[str, ...], least: float, model: Model, slow: Course
) -> None:
    """Alone, or beside the other one, which is right; the preloads are those of the file."""
    faults = Faults(quarter_rate(), sensors=sensors, lies={name: lie}, cell_ns=SELDOM)
    outputs = run(model, slow, faults)
    verdict = judge(slow, outputs, 0, slow.duration_ns)
    assert verdict.ratio.size >= least * verdict.judged
    assert verdict.beyond(5.0) <= 0.001


def test_a_good_cell_beside_a_wrong_preload_leaves_its_cable_with_status_0(model: Model) -> None:
    preload = number_at(dict(model.robot.document), "cables.upper.preload")
    other = with_other_numbers(model, {"cables.upper.preload": preload / 0.8})
    true = course_of(other, 12.0, sine(0.3, 0.45))
    outputs = run(model, true, Faults(quarter_rate(), sensors=(CELL,), cell_ns=SELDOM))
    upper = np.array([one.status[:8] for one in outputs if one.stamp_ns > START + 6 * SECOND])
    assert np.mean(upper == 0) > 0.99
    assert judge(true, outputs, 0, true.duration_ns).beyond(5.0) <= 0.001


def test_good_sensors_leave_the_same_share_with_status_0(model: Model, longer: Course) -> None:
    """Unknown biases and gains do not make them useless."""
    for sensors, least in (((CELL,), 0.44), ((CELL, EFFORT), 0.80)):
        outputs = run(model, longer, Faults(quarter_rate(), sensors=sensors, cell_ns=SELDOM))
        verdict = judge(longer, outputs, 0, longer.duration_ns)
        assert verdict.ratio.size >= least * verdict.judged
        assert verdict.beyond(2.0) <= 0.08


@pytest.mark.parametrize("steps", [1, 7, 100])
def test_what_a_creeping_evidence_leaves_open_does_not_depend_on_its_steps(steps: int) -> None:
    evidence = PreloadEvidence()
    assert evidence.contradicted(0.0, 0.5) == 0.0
    added = [evidence.contradicted(4.0 * k / steps, 0.6) for k in range(1, steps + 1)]
    assert np.sum(np.square(added)) == pytest.approx(0.5 * (4.0**2 - 0.5**2))
    assert evidence.contradicted(3.0, 0.6) == 0.0, "nothing is added on the way back"


def test_a_first_correction_allows_more_until_a_motion_to_and_fro() -> None:
    def opened(evidence: PreloadEvidence) -> float:
        assert evidence.contradicted(0.0, 0.2) == 0.0
        return evidence.contradicted(1.5, 0.2)

    early, late = PreloadEvidence(first=10.0), PreloadEvidence(first=10.0)
    for unaided in (20.0, 24.0, 20.0):
        assert not late.settled
        late.follow(unaided, 3.0)
    assert late.settled
    assert opened(early) == 0.0
    assert opened(late) > 0.5


def _sensor() -> SensorState:
    generator = np.random.default_rng(0)
    errors = LastingError.of(CELL_ERRORS, 36.85, 0.0, lambda apart: standard(generator, 32, apart))
    sensor = SensorState(errors, model_error=0.4)
    for k in range(100):
        assert sensor.gate(k * 10_000_000, 0.1, 0.2, 0.01) == "agrees"
    return sensor


def test_readings_that_stay_away_are_a_change() -> None:
    sensor = _sensor()
    answers = [sensor.gate(SECOND + k, 4.0, 0.2, 0.01) for k in range(LASTING)]
    assert answers == ["contradicts"] * (LASTING - 1) + ["changed"]
    assert sensor.contradiction == 4.0


def test_an_estimate_that_becomes_uncertain_does_not_refute_readings_that_stay_away() -> None:
    """As where angles are lost: the reading says what it said, and the estimate nothing."""
    sensor = _sensor()
    answers = [sensor.gate(SECOND + k, 4.0, 9.0 if k % 2 else 0.2, 0.01) for k in range(LASTING)]
    assert answers == ["contradicts"] * (LASTING - 1) + ["changed"]
    assert sensor.gate(SECOND + LASTING, 0.1, 9.0, 0.01) == "agrees"
    assert not sensor.contradicts


def test_a_change_in_small_steps_is_one_all_the_same() -> None:
    """Every reading agrees with the estimate, which follows it."""
    sensor = _sensor()
    answers = []
    for k in range(50):
        answers.append(sensor.gate(SECOND + k * 10_000_000, 0.2, 0.2, 0.01))
        sensor.note(0.2)
    assert answers[0] == "agrees"
    assert "changed" in answers


@pytest.mark.parametrize("checked_by_effort", [False, True])
def test_a_slow_change_is_one_where_an_effort_can_decide(checked_by_effort: bool) -> None:
    """By 0.5 N in a second, of which a second alone shows nothing."""
    sensor = _sensor()
    sensor.checked_by_effort = checked_by_effort
    answers = set()
    for k in range(250):
        answers.add(sensor.gate(SECOND + 20 * MS * k, 0.01, 0.2, 0.01))
        sensor.note(0.01)
    assert ("changed" in answers) == checked_by_effort
    assert checked_by_effort or answers == {"agrees"}


def test_draws_are_not_correlated_with_what_they_are_kept_apart_from() -> None:
    generator = np.random.default_rng(0)
    known = [3.0 * generator.standard_normal(32) + 1.0 for _ in range(3)]
    normal = standard(generator, 32, known)
    assert abs(normal.mean()) < 1e-12
    assert np.mean(normal**2) == pytest.approx(1.0)
    assert max(abs(normal @ one) for one in known) < 1e-10


def _run(
    model: Model, samples: Samples, calm: int, changed: tuple[str, ...]
) -> tuple[LiveEstimator, float]:
    """Both cells of the upper cable, of which some read ``CHANGE`` more after ``calm`` samples.

    Until then both have been trusted.

    Returns:
        The estimator, and how far the tension at one of them is from the uncorrected estimate [N].
    """
    live = LiveEstimator(model, Options(tension_sensors=True))
    alone = estimator.run(model, estimator.initial_state(model), samples)[1]
    tension = alone.values[:, model.layout.tension]
    generator = np.random.default_rng(3)
    off = 0.0
    for k in range(2 * calm):
        sample = samples.at(k)
        for cell in ("upper/3", "upper/8"):
            true = float(tension[k, model.layout.elements.index(cell)])
            change = CHANGE if k >= calm and cell in changed else 0.0
            said = true + change + float(generator.normal(0.0, 0.05))
            live.feed_tensions(sample.stamp_ns, [cell], [said], [0.05])
        output = live.take(sample)
        off = float((output.tension - tension[k])[7])
        if k == calm + 2 and changed:
            assert np.all(output.status.astype(int) & UNSURE), "until it is decided"
            assert live.fusion is not None
            health = live.fusion.sensors.health
            assert sum(one.used > 100 for one in health.values()) == 2
            assert all(one.refused == (3 if n in changed else 0) for n, one in health.items())
    assert output.stddev is not None
    assert output.stddev[7] < 2.0
    return live, off


def test_two_cells_that_change_together_show_a_change_of_preload(
    model: Model, recorded: Callable[[Model, int], Samples]
) -> None:
    live, off = _run(model, recorded(model, 60), 500, ("upper/3", "upper/8"))
    assert live.fusion is not None
    assert live.fusion.sensors.faults() == {}
    assert abs(off - CHANGE) < 1.0
    assert live.ensemble is not None
    assert not live.ensemble.core.least_variance.any(), "each confirms the other"


def test_a_cell_that_changes_alone_is_not_believed(
    model: Model, recorded: Callable[[Model, int], Samples]
) -> None:
    _, off = _run(model, recorded(model, 60), 500, ("upper/3",))
    assert abs(off) < 1.0
