"""Beliefs about unknowns and sensors: laws of the filter and of the hypotheses."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np
import pytest

from cdrj_ros.estimation import beliefs
from cdrj_ros.estimation.beliefs import Beliefs
from cdrj_ros.estimation.sensors import Sensor
from cdrj_ros.estimation.unknowns import Unknown

SECOND: Final = 1_000_000_000
NOISE: Final = 0.1


def _unknowns(count: int, jump: float = 0.0) -> list[Unknown]:
    """Unknowns of standard deviation 1 that do not drift."""
    nothing: Any = None
    return [Unknown(f"u{k}", 1.0, 1.0, 0.0, jump, nothing) for k in range(count)]


def _sensor(name: str, **changes: Any) -> Sensor:
    """A sensor without errors that last."""
    given: dict[str, Any] = {
        "name": name, "column": 0, "cables": (0,), "noise": NOISE, "scale": 10.0,
        "prior": (0.0, 0.0, 0.0), "drift": 0.0, "model": (0.0, 0.0),
    }  # fmt: skip
    return Sensor(**given | changes)


def _read(
    known: Beliefs, k: int, second: float, value: float, slopes: list[float], h: float = 10.0
) -> None:
    stamp = round(second * SECOND)
    known.take(k, stamp, value, NOISE, h, np.array(slopes), 0.0, 0.0)


def test_a_right_sensor_gives_the_least_squares_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beliefs, "NONLINEAR", 0.0)
    generator = np.random.default_rng(0)
    true, slopes = np.array([0.7, -0.4, 0.2]), generator.normal(size=(40, 3))
    values = 10.0 + slopes @ true + NOISE * generator.normal(size=40)
    known = Beliefs(_unknowns(3))
    known.hear(_sensor("cell"))
    for k, (row, value) in enumerate(zip(slopes, values, strict=True)):
        _read(known, 0, k, float(value), row.tolist())
    inverse = np.linalg.inv(np.eye(3) + slopes.T @ slopes / NOISE**2)
    assert np.allclose(known.mean[0, :3], inverse @ slopes.T @ (values - 10.0) / NOISE**2)
    assert np.allclose(known.covariance[0, :3, :3], inverse)


def test_no_sensor_that_a_hypothesis_holds_wrong_touches_it() -> None:
    known = Beliefs(_unknowns(2))
    known.hear(_sensor("a"))
    known.hear(_sensor("b"))
    without = [list(row) for row in known.right].index([False, True])
    before = known.mean[without].copy(), known.covariance[without].copy()
    for k in range(20):
        _read(known, 0, k, 12.0, [1.0, 0.3])
    assert np.array_equal(known.mean[without], before[0])
    assert np.array_equal(known.covariance[without], before[1])


@pytest.mark.parametrize("wrong", [0, 1, 2])
def test_of_three_sensors_of_one_quantity_the_one_that_differs_is_wrong(wrong: int) -> None:
    generator = np.random.default_rng(wrong)
    known = Beliefs(_unknowns(1))
    for name in "abc":
        known.hear(_sensor(name))
    for k in range(60):
        for one in range(3):
            off = 4.0 * (one == wrong)
            _read(known, one, 0.1 * k, 10.5 + off + NOISE * generator.normal(), [1.0])
    right = [known.probability_right(k) for k in range(3)]
    assert right.index(min(right)) == wrong
    assert min(right) < 0.01
    assert sorted(right)[1] > 0.9
    mean, stddev = known.moments()
    assert abs(mean[0] - 0.5) < 0.2
    assert stddev[0] < 1.0


def test_what_a_single_sensor_has_corrected_stays_open_to_a_tenth() -> None:
    """It may be wrong, whatever it reads; a verified one hardly."""
    left = {}
    for verified in (False, True):
        known = Beliefs(_unknowns(1))
        known.hear(_sensor("cell", verified=verified))
        for k in range(200):
            _read(known, 0, k, 11.0, [1.0])
        left[verified] = known.moments()[1][0] ** 2
    assert left[False] == pytest.approx(2.0 * 0.1 / 1.1, rel=0.1)  # prior and shift, both of 1
    assert left[True] < 0.15 * left[False]


def test_a_sudden_change_is_taken_up_and_a_stray_reading_is_not() -> None:
    generator = np.random.default_rng(4)

    def after(jump: float, readings: int) -> float:
        known = Beliefs(_unknowns(1, jump=3.0))
        known.hear(_sensor("cell"))
        for k in range(100):
            _read(known, 0, 0.1 * k, 10.0 + NOISE * generator.normal(), [1.0])
        for k in range(readings):
            _read(known, 0, 10.0 + 0.1 * k, 10.0 + jump + NOISE * generator.normal(), [1.0])
        return float(known.mean[0, 0])

    assert after(2.0, 30) == pytest.approx(2.0, abs=0.3)
    assert abs(after(200.0, 1)) < 0.1


def test_readings_that_repeat_while_the_estimate_moves_are_no_readings() -> None:
    generator = np.random.default_rng(5)
    known = Beliefs(_unknowns(1))
    known.hear(_sensor("frozen"))
    known.hear(_sensor("good"))
    for k in range(100):
        h = 10.0 + 2.0 * np.sin(0.3 * k)
        _read(known, 0, 0.1 * k, 10.0, [1.0], h)
        _read(known, 1, 0.1 * k + 0.05, h + NOISE * generator.normal(), [1.0], h)
    assert known.heard[0].frozen
    assert known.probability_right(0) < 0.01
    assert known.probability_right(1) > 0.9


def test_what_is_known_outlasts_a_restart_and_damage_is_refused() -> None:
    sensors = {name: _sensor(name) for name in ("a", "b")}
    known = Beliefs(_unknowns(2))
    for sensor in sensors.values():
        known.hear(sensor)
    for k in range(10):
        _read(known, k % 2, k, 10.4, [1.0, -0.5])
    memory = json.loads(json.dumps(known.memory()))
    again = Beliefs(_unknowns(2))
    again.recall(memory, sensors)
    assert np.array_equal(again.mean, known.mean)
    assert np.array_equal(again.covariance, known.covariance)
    assert np.array_equal(again.weight, known.weight)
    damages: list[dict[str, Any]] = [
        {"mean": [[0.0]]},
        {"covariance": (-np.array(memory["covariance"])).tolist()},
        {"weight": [float("nan")] * 4},
        {"sensors": [["c", 0], ["b", 0]]},
        {"sensors": []},
    ]
    for damage in damages:
        with pytest.raises((KeyError, TypeError, ValueError)):
            again.recall(memory | damage, sensors)
        assert np.array_equal(again.mean, known.mean)
        assert len(again.heard) == 2
