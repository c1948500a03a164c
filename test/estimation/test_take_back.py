"""Corrections by a trusted sensor are undone permanently once the sensor is found to be wrong."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pytest

from cdrj_ros.estimation import estimator
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.estimation.sensor_health import SensorHealth
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.estimation.state_file import read_state, write_state
from cdrj_ros.model.packing import UNSURE
from cdrj_ros.model.prepared import Model

CELL: Final = "upper/8"
MEASURED = Options(tension_sensors=True)
CALM: Final = 2000
"""Number of samples after which the cell reads wrong."""
SCALE: Final = 1.2
"""Before that, the readings are too high by this factor and follow the motion: it is trusted."""

SENSORS: Final = int(os.environ.get("CDRJ_SENSORS", "5"))
"""Number of sensors of every kind that are never to be trusted; 50 in ``make soak``."""


class Beside(NamedTuple):
    """A motion and its estimates without other sensors."""

    samples: Samples
    tension: np.ndarray
    """Shape (n, elements)."""
    cell: np.ndarray
    """Tension of the cell's element, shape (n,)."""


@pytest.fixture(scope="module")
def beside(model: Model, recorded: Callable[[Model, int], Samples]) -> Beside:
    """Recorded angles at 100 Hz with the uncorrected estimates."""
    samples = recorded(model, 15)
    samples = Samples(*(column[:3000].copy() for column in vars(samples).values()))
    alone = estimator.run(model, estimator.initial_state(model), samples)[1]
    tension = alone.values[:, model.layout.tension]
    return Beside(samples, tension, tension[:, model.layout.elements.index(CELL)])


Lie = Callable[[Beside, int], float]

LIES: dict[str, Lie] = {
    "freezes": lambda beside, _k: SCALE * float(beside.cell[CALM]),
    "says zero": lambda _beside, _k: 0.0,
    "doubles": lambda beside, k: 2.0 * SCALE * float(beside.cell[k]),
}


def _feed_cell(live: LiveEstimator, beside: Beside, k: int, lie: Lie, scale: float = SCALE) -> None:
    """Feed a reading of the cell with every second sample, at first in proportion."""
    if k % 2 == 0:
        value = scale * float(beside.cell[k]) + 0.02 * (k % 8 - 3)
        if k >= CALM:
            value = lie(beside, k)
        live.feed_tensions(int(beside.samples.stamp_ns[k]), [CELL], [value], [0.05])


def _dropped(live: LiveEstimator) -> str:
    assert live.fusion is not None
    health = live.fusion.sensors.health.get(CELL)
    return health.dropped if health is not None else ""


@pytest.mark.parametrize("lie", ["freezes", "doubles"])
def test_corrections_by_a_trusted_load_cell_are_undone_once_it_is_dropped(
    lie: str, model: Model, beside: Beside
) -> None:
    live = LiveEstimator(model, MEASURED)
    taught = 0.0
    found = -1
    for k in range(beside.cell.size):
        _feed_cell(live, beside, k, LIES[lie])
        output = live.take(beside.samples.at(k))
        off = np.abs(output.tension - beside.tension[k])[:8].max()
        if k < CALM:
            taught = off
        if found >= 0:
            assert off < 1e-9, "as without the cell"
        elif _dropped(live):
            found = k
            assert np.all(output.status.astype(int) & UNSURE)
    assert live.fusion is not None
    health = live.fusion.sensors.health[CELL]
    assert taught > 1.0, "it was trusted, and moved the preload"
    assert health.used > 100
    assert CALM <= found < CALM + 700
    used, refused = health.used, health.refused
    assert refused > 200, "it stays dropped"
    _feed_cell(live, beside, 2998, LIES[lie])
    live.take(beside.samples.at(2999)._replace(stamp_ns=int(beside.samples.stamp_ns[-1]) + 1))
    assert (health.used, health.refused) == (used, refused + 1)
    assert np.array_equal(live.state.values, live.uncorrected.values)


@pytest.mark.parametrize("off", [1.0, 1000.0])
def test_a_single_outlier_is_refused_and_drops_no_sensor(
    off: float, model: Model, beside: Beside
) -> None:
    """Before it and after it the cell is good: 1000 N off are thousands of deviations."""
    live = LiveEstimator(model, MEASURED)
    for k in range(CALM + 600):
        sudden = off if k == CALM else 0.0
        _feed_cell(live, beside, k, lambda _b, k, add=sudden: 1.05 * beside.cell[k] + add, 1.05)
        live.take(beside.samples.at(k))
    assert live.fusion is not None
    health = live.fusion.sensors.health[CELL]
    assert health.dropped == ""
    assert health.refused == (1 if off > 1.0 else 0)
    assert health.used > 300


def test_persistent_outliers_drop_a_sensor(model: Model, beside: Beside) -> None:
    """A third of the readings is wild."""
    live = LiveEstimator(model, MEASURED)
    for k in range(CALM + 200):
        _feed_cell(live, beside, k, lambda b, k: SCALE * b.cell[k] + 100.0 * (k % 6 == 0))
        live.take(beside.samples.at(k))
    assert "readings more than 10 standard deviations" in _dropped(live)


@pytest.mark.parametrize("how", ["restart", "clock"])
def test_a_dropped_sensor_stays_dropped(
    how: str, model: Model, beside: Beside, tmp_path: Path
) -> None:
    """It could pass another trial, and lie again."""
    live = LiveEstimator(model, MEASURED)
    for k in range(CALM + 200):
        _feed_cell(live, beside, k, LIES["says zero"])
        live.take(beside.samples.at(k))
    why = _dropped(live)
    assert why
    if how == "restart":
        write_state(live, tmp_path / "state")
        live = LiveEstimator(model, MEASURED)
        read_state(live, tmp_path / "state")
    else:
        for k in range(40):
            sample = beside.samples.at(CALM + 200 + k)
            stamp = sample.stamp_ns - (3600 * 10**9 if k >= 20 else 0)
            live.feed("joints", stamp, ("elbow",), sample.joint_angle)
            live.feed("motors", stamp, ("winch",), sample.motor_angle)
        assert live.conditioner.clock_jumps == 1
    assert _dropped(live) == why
    live.reset()
    assert _dropped(live) == ""


@pytest.mark.parametrize("kind", ["noise", "drift", "stuck", "opposite"])
def test_what_does_not_follow_the_motion_is_never_trusted(kind: str) -> None:
    """Many sensors of each kind beside an estimate that moves to and fro, or one way."""
    generator = np.random.default_rng(0)
    own = 0.1
    for _ in range(SENSORS):
        health = SensorHealth("cell")
        estimate = 30.0 + 10.0 * np.sin(np.linspace(0.0, 12.0, 600) + generator.uniform(0.0, 6.0))
        if kind == "drift":
            estimate = np.linspace(20.0, 40.0, 600)
        noise = generator.normal(0.0, own**0.5, 600)
        said = {
            "noise": 30.0 + 5.0 * noise / own**0.5, "stuck": 30.0 + noise,
            "drift": estimate + noise, "opposite": 60.0 - estimate + noise,
        }[kind]  # fmt: skip
        for value, now in zip(said.tolist(), estimate.tolist(), strict=True):
            assert not health.evaluate(value, now, now, 100.0, own)
        assert health.tried + health.refused == 600
        assert health.tried >= 50


def test_a_good_sensor_is_trusted_within_a_motion_to_and_fro() -> None:
    generator = np.random.default_rng(1)
    for gain in (0.8, 1.0, 1.3):
        health = SensorHealth("cell")
        estimate = 30.0 + 10.0 * np.sin(np.linspace(0.0, 6.3, 600))
        used = [
            health.evaluate(gain * now + float(generator.normal(0.0, 0.3)), now, now, 100.0, 0.1)
            for now in estimate.tolist()
        ]
        assert not used[0]
        assert used[-1]
        assert health.tried < 500


@pytest.mark.parametrize("gain", [0.0, 0.8, 1.3])
def test_a_sensor_that_does_not_follow_a_stroke_is_doubted_until_it_follows(gain: float) -> None:
    """It follows with an offset from then on: the preload was lost during the stroke."""
    generator = np.random.default_rng(2)
    health, angle = SensorHealth("cell"), 0.0

    def read(estimate: float, said: float) -> None:
        health.evaluate(said + float(generator.normal(0.0, 0.3)), estimate, estimate, 100.0, 0.1)

    def swing() -> float:
        return float(30.0 + 10.0 * np.sin(angle))

    while not health.trusted:
        angle += 0.01
        read(swing(), swing())
    start, stroke = swing(), -8.0
    for moved in [*np.linspace(0.0, stroke, 8), *[stroke] * 50]:
        read(start + float(moved), start + gain * float(moved))
    assert health.doubted == (gain == 0.0)
    for _ in range(120):
        angle += 0.1
        read(swing() + stroke, swing() + gain * stroke)
    assert health.trusted
    assert not health.doubted
    assert not health.dropped
