"""What is known of sensors and preloads outlasts restarts, clocks that are set, gaps and delays."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.campaign import (
    CELL,
    MS,
    SECOND,
    START,
    Course,
    Faults,
    Lie,
    course_of,
    judge,
    quarter_rate,
    run,
    sine,
)

from cdrj_ros.estimation.changes import with_other_numbers
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.estimation.state_file import StateFileError, read_state, write_state
from cdrj_ros.model.prepared import Model, load_model

BREAK = 6 * SECOND
HOUR = 3600 * SECOND
MEASURED = Options(tension_sensors=True)


@pytest.fixture(scope="module")
def course(model: Model) -> Course:
    return course_of(model, 11.0, sine(0.3, 0.45))


BREAKS = {
    "restart": Faults(quarter_rate(), sensors=(CELL,), restart_ns=BREAK, stop_ns=SECOND // 2),
    "clock back": Faults(quarter_rate(), sensors=(CELL,), clock_ns=(BREAK, -HOUR)),
    "clock ahead": Faults(quarter_rate(), sensors=(CELL,), clock_ns=(BREAK, HOUR)),
    "gap": Faults(
        quarter_rate(),
        sensors=(CELL,),
        gaps=[(axis, BREAK, BREAK + 3 * SECOND // 2) for axis in ("winch", "elbow")],
    ),
}


@pytest.mark.parametrize(("name", "off"), [("restart", 3.0), ("clock back", 3.0), ("gap", -3.0)])
def test_a_trusted_cell_that_is_off_after_a_break_is_not_believed(
    name: str, off: float, model: Model, course: Course, tmp_path: Path
) -> None:
    """It would be if the preload were as uncertain as at the start, and the cell on trial again."""
    # in a gap a cell stays trusted, and nothing contradicts one that lies while friction is unknown
    begin = BREAK + (2 * SECOND if name == "gap" else 0)
    faults = replace(BREAKS[name], lies={CELL: Lie("is off", begin, off)})
    outputs = run(model, course, faults, scratch=tmp_path)
    before = judge(course, outputs, BREAK - SECOND, BREAK)
    verdict = judge(course, outputs, BREAK, course.duration_ns)
    assert before.ratio.size >= 0.49 * before.judged, "the cell of the upper cable is trusted"
    assert verdict.judged > 0
    assert verdict.beyond(5.0) <= 0.001
    assert verdict.beyond(2.0) <= 0.08


@pytest.mark.parametrize("name", ["restart", "clock ahead"])
def test_a_good_cell_is_trusted_after_a_break_as_before(
    name: str, model: Model, course: Course, tmp_path: Path
) -> None:
    outputs = run(model, course, BREAKS[name], scratch=tmp_path)
    end = judge(course, outputs, course.duration_ns - SECOND, course.duration_ns)
    assert end.ratio.size >= 0.49 * end.judged
    assert end.beyond(2.0) == 0.0


# A preload that the robot file gives wrongly ----------------------------------------------------


LOST = "29.5,26.26"
"""The upper preload is 20 % lower than in the file [N]."""


def _learned(model: Model, course: Course) -> LiveEstimator:
    """An estimator that has learned the lost preload from a cell, after ``BREAK``."""
    true = course_of(load_model("prototype", LOST), BREAK / SECOND, sine(0.3, 0.45))
    live = LiveEstimator(model, MEASURED)
    for k in range(0, BREAK // MS, 2):
        stamp = START + k * MS
        if k % 10 == 0:
            said = float(true.tension[k, 7]) + 0.05 * np.sin(1e3 * k)
            live.feed_tensions(stamp, (CELL,), (said,), (0.05,))
        _feed(live, course, k, 0)
    assert live.fusion is not None
    assert live.fusion.sensors.health[CELL].used > 100
    return live


def _feed(live: LiveEstimator, course: Course, k: int, shift_ns: int) -> list[Any]:
    stamp = START + k * MS + shift_ns
    live.feed("joints", stamp, ("elbow",), (course.elbow[k],))
    return live.feed("motors", stamp, ("winch",), (course.winch[k],))[1]


def _mean(output: Any) -> tuple[float, float]:
    """Mean tension of the upper cable and mean standard deviation there [N]."""
    return float(output.tension[:8].mean()), float(output.stddev[:8].mean())


@pytest.fixture
def learned(model: Model, course: Course) -> LiveEstimator:
    return _learned(model, course)


@pytest.fixture(scope="module")
def unchanged(model: Model, course: Course) -> LiveEstimator:
    """The same for tests that do not go on with it."""
    return _learned(model, course)


def test_it_is_known_when_numbers_have_changed(
    model: Model, course: Course, learned: LiveEstimator
) -> None:
    assert learned.fusion is not None
    assert learned.ensemble is not None
    known = learned.fusion.memory()["changed"]
    assert known[0] < -3.0
    learned.set_numbers({"friction.mu_c": 0.1})
    assert learned.fusion.memory()["changed"] == known
    (output,) = _feed(learned, course, BREAK // MS, 0)
    fresh = LiveEstimator(model, MEASURED)
    (other,) = _feed(fresh, course, BREAK // MS, 0)
    assert _mean(output)[1] < 0.8 * _mean(other)[1], "the preload is no longer as uncertain"


def test_a_reset_forgets_it(model: Model, course: Course, learned: LiveEstimator) -> None:
    learned.reset()
    fresh = LiveEstimator(model, MEASURED)
    for k in range(20):
        one, other = (_feed(live, course, k, 0) for live in (learned, fresh))
        for mine, its in zip(one, other, strict=True):
            assert np.array_equal(mine.values, its.values)
            assert np.array_equal(mine.stddev, its.stddev)
    assert learned.fusion is not None
    assert learned.fusion.sensors.health == {}


def test_a_state_file_holds_all_that_is_known(
    model: Model, unchanged: LiveEstimator, tmp_path: Path
) -> None:
    path = tmp_path / "state"
    write_state(unchanged, path)
    again = LiveEstimator(model, MEASURED)
    read_state(again, path)
    assert unchanged.fusion is not None
    assert again.fusion is not None
    assert again.fusion.memory() == unchanged.fusion.memory()
    assert not again.fusion.sensors.health[CELL].trusted, "it is on trial again"
    without = LiveEstimator(model)
    assert read_state(without, path), "sensors are no longer used"


def _damaged(memory: Any, *path: str, value: Any) -> Any:
    copy = json.loads(json.dumps(memory))
    at = copy
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    return copy


def test_a_memory_that_is_not_one_is_refused_and_changes_nothing(
    model: Model, unchanged: LiveEstimator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert unchanged.fusion is not None
    memory = unchanged.fusion.memory()
    own = {key: memory["sensors"][CELL][key] for key in ("errors", "own", "evidence")}
    wrong = [
        _damaged(memory, "known", value=[0.0]),
        _damaged(memory, "changed", value="much"),
        _damaged(memory, "health", value={}),
        _damaged(memory, "health", "upper/99", value=memory["health"][CELL]),
        _damaged(memory, "health", CELL, "largest", value=float("nan")),
        *(_damaged(memory, "sensors", CELL, key, value=[*one, 1.0]) for key, one in own.items()),
        *(
            _damaged(memory, "sensors", CELL, key, value=[float("inf"), *one[1:]])
            for key, one in own.items()
        ),
        {}, [], 7, None,
    ]  # fmt: skip
    for one in wrong:
        monkeypatch.setattr(unchanged.fusion, "memory", lambda one=one: one)
        write_state(unchanged, tmp_path / "state")
        again = LiveEstimator(model, MEASURED)
        with pytest.raises(StateFileError, match="no usable list of sensors"):
            read_state(again, tmp_path / "state")
        assert again.fusion is not None
        assert again.fusion.memory()["health"] == {}


def test_what_a_dropped_cell_said_last_may_be_right(model: Model, course: Course) -> None:
    """Its cable has lost too much at once to be taken for a change of preload."""
    preloads = [cable.preload for cable in model.robot.cables]
    true = load_model("prototype", [0.4 * preloads[0], preloads[1]])
    after = course_of(true, course.duration_ns / SECOND, sine(0.3, 0.45))
    live = LiveEstimator(model, MEASURED)
    within = []
    for k in range(9 * SECOND // MS):
        truth = (course if k < BREAK // MS else after).tension[k]
        if k % 10 == 0:
            said = float(truth[7]) + 0.05 * np.sin(1e3 * k)
            live.feed_tensions(START + k * MS, (CELL,), (said,), (0.05,))
        for output in _feed(live, course, k, 0):
            if k > BREAK // MS + 500:
                assert np.all(output.status[:8] != 0)
                off = np.abs(output.tension - truth)[:8]
                within.append(off <= 2.0 * output.stddev[:8])
    assert live.fusion is not None
    assert CELL in live.fusion.sensors.faults()
    assert len(within) > 2000
    assert np.mean(within) >= 0.92


@pytest.mark.parametrize(("share", "late"), [(0.95, 50), (1.05, 150)])
def test_a_late_reading_tells_less_where_the_tension_has_changed_since(
    share: float, late: int, model: Model
) -> None:
    """The cell is first used after a reversal, with a reading of the other side of the friction."""
    changed = {f"cables.{one.name}.preload": share * one.preload for one in model.robot.cables}
    course = course_of(with_other_numbers(model, changed), 12.0, sine(0.3))
    faults = Faults(quarter_rate(), sensors=(CELL,), late_ns={CELL: late * MS})
    verdict = judge(course, run(model, course, faults), 0, 12 * SECOND)
    assert verdict.ratio.size > 0.4 * verdict.judged
    assert verdict.beyond(2.0) < 0.05
    assert verdict.beyond(5.0) == 0.0
