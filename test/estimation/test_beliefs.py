"""Beliefs about unknowns and sensors: laws of the filter and of the hypotheses."""

import json

import numpy as np
import pytest

from cdrj_ros._core import NONLINEAR
from cdrj_ros.estimation.beliefs import Beliefs
from cdrj_ros.estimation.sensors import Accuracy, Sensor
from cdrj_ros.estimation.unknowns import Kind, Unknown

SECOND = 1_000_000_000
NOISE = 0.1


def _unknowns(count, jump=0.0, error=NONLINEAR):
    """Unknowns of standard deviation 1 that do not drift."""
    nothing = None
    kind = Kind("any", "{}", 1.0, start=1.0, jump=jump, error=error)
    return [Unknown(kind, f"u{k}", 1.0, nothing, nothing) for k in range(count)]


def _sensor(name, **changes):
    """A sensor without errors that last."""
    given = {
        "name": name, "column": 0, "cables": (0,), "noise": NOISE, "scale": 10.0, "balance": 10.0,
        "accuracy": Accuracy(0.0, 0.0, 0.0, 0.0, 0.0),
    }  # fmt: skip
    return Sensor(**given | changes)


def _hear(known, *names, **changes):
    """Add sensors that read the first of three quantities."""
    for name in names:
        known.hear(_sensor(name, **changes), 0, np.ones(3, dtype=np.bool_))


def _read(known, k, second, value, slopes, h=10.0):
    stamp = round(second * SECOND)
    known.core.take(k, stamp, value, NOISE, h, np.array(slopes), 0.0, np.array([h]))


def test_a_right_sensor_gives_the_weighted_least_squares_solution():
    """In information form; what signatures do not say is a part of the noise."""
    generator = np.random.default_rng(0)
    true, slopes = np.array([0.7, -0.4, 0.2]), generator.normal(size=(40, 3))
    values = 10.0 + slopes @ true + NOISE * generator.normal(size=40)
    known = Beliefs(_unknowns(3))
    _hear(known, "cell")
    information, weighted = np.eye(3), np.zeros(3)
    for k, (row, value) in enumerate(zip(slopes, values, strict=True)):
        shift = row @ np.linalg.solve(information, weighted)
        weight = 1.0 / (NOISE**2 + (NONLINEAR * shift) ** 2)
        information += weight * np.outer(row, row)
        weighted += weight * row * (value - 10.0)
        _read(known, 0, k, float(value), row.tolist())
    assert np.allclose(known.core.mean[0, :3], np.linalg.solve(information, weighted))
    assert np.allclose(known.core.covariance[0, :3, :3], np.linalg.inv(information))


def test_no_sensor_that_a_hypothesis_holds_wrong_touches_it():
    known = Beliefs(_unknowns(2))
    _hear(known, "a", "b")
    without = [list(row) for row in known.core.right].index([False, True])
    before = known.core.mean[without].copy(), known.core.covariance[without].copy()
    for k in range(20):
        _read(known, 0, k, 12.0, [1.0, 0.3])
    assert np.array_equal(known.core.mean[without], before[0])
    assert np.array_equal(known.core.covariance[without], before[1])


@pytest.mark.parametrize("wrong", [0, 1, 2])
def test_of_three_sensors_of_one_quantity_the_one_that_differs_is_wrong(wrong):
    generator = np.random.default_rng(wrong)
    known = Beliefs(_unknowns(1))
    _hear(known, *"abc")
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


def test_what_contradicts_all_sensors_is_the_model():
    """Of two that contradict it and each other either may be right, or what they read of."""
    generator = np.random.default_rng(8)
    known = Beliefs(_unknowns(1))
    _hear(known, *"ab")
    for k in range(60):
        for one, off in enumerate((6.0, -7.0)):
            value = 10.0 + off * np.sin(0.7 * k + one) + NOISE * generator.normal()
            _read(known, one, 0.1 * k, value, [0.01])
    for k in range(2):
        assert known.core.weight @ known.core.right[:, k] < 0.1
        assert known.probability_right(k) > 0.9


def test_what_a_single_sensor_has_corrected_stays_open_to_a_tenth():
    """It may be wrong, whatever it reads; a verified one hardly."""
    left = {}
    for verified in (False, True):
        known = Beliefs(_unknowns(1))
        _hear(known, "cell", verified=verified)
        for k in range(200):
            _read(known, 0, k, 11.0, [1.0])
        left[verified] = known.moments()[1][0] ** 2
    assert left[False] == pytest.approx(2.0 * 0.1 / 1.1, rel=0.1)  # prior and shift, both of 1
    assert left[True] < 0.15 * left[False]


def test_a_sudden_change_is_taken_up_and_a_stray_reading_is_not():
    generator = np.random.default_rng(4)

    def after(jump, readings):
        known = Beliefs(_unknowns(1, jump=3.0))
        _hear(known, "cell")
        for k in range(100):
            _read(known, 0, 0.1 * k, 10.0 + NOISE * generator.normal(), [1.0])
        for k in range(readings):
            _read(known, 0, 10.0 + 0.1 * k, 10.0 + jump + NOISE * generator.normal(), [1.0])
        return float(known.core.mean[0, 0])

    assert after(2.0, 30) == pytest.approx(2.0, abs=0.3)
    assert abs(after(200.0, 1)) < 0.1


def test_readings_that_repeat_while_the_estimate_moves_are_no_readings():
    generator = np.random.default_rng(5)
    known = Beliefs(_unknowns(1))
    _hear(known, "frozen", "good")
    for k in range(100):
        h = 10.0 + 2.0 * np.sin(0.3 * k)
        _read(known, 0, 0.1 * k, 10.0, [1.0], h)
        _read(known, 1, 0.1 * k + 0.05, h + NOISE * generator.normal(), [1.0], h)
    assert known.core.heard(0)[2], "frozen"
    assert known.probability_right(0) < 0.01
    assert known.probability_right(1) > 0.9


def test_sensors_that_agree_are_right_however_steady_their_readings_are():
    """What signatures do not say of a large correction lasts, whether a sensor is right or not."""
    generator = np.random.default_rng(7)
    known = Beliefs(_unknowns(1))
    _hear(known, *"ab")
    for k in range(100):
        for one in range(2):
            _read(known, one, 0.1 * k, 30.0 + NOISE * generator.normal(), [20.0])
    assert known.core.mean[0, 0] == pytest.approx(1.0, abs=0.05)
    assert min(known.probability_right(one) for one in range(2)) > 0.9


def test_a_reading_beyond_all_bounds_is_no_reading():
    known = Beliefs(_unknowns(1, jump=3.0) + _unknowns(1))
    _hear(known, "broken", "good")
    for k in range(30):
        _read(known, 1, 0.1 * k, 10.0, [1.0, 0.5])
        before = known.core.mean[0].copy()
        _read(known, 0, 0.1 * k + 0.05, 1e6, [1.0, 0.5])
        assert np.allclose(known.core.mean[0], before)
    assert known.probability_right(0) < 0.01
    assert known.probability_right(1) > 0.9


@pytest.mark.parametrize(
    ("values", "is_open"),
    [
        ([10.0] * 5, False),
        ([10.0] * 5 + [20.0], False),
        ([10.0] * 5 + [20.0] * 2, False),
        ([10.0] * 5 + [20.0] * 3, True),
        ([20.0], True),
        ([20.0] * 2, True),
    ],
)
def test_a_reading_far_off_opens_the_present_unless_it_may_be_a_single_wrong_one(values, is_open):
    """It is 100 % off, and so may be what its cable contributes to, in one of two hypotheses."""
    known = Beliefs(_unknowns(1))
    _hear(known, "cell")
    for k, value in enumerate(values):
        _read(known, 0, 0.02 * k, value, [0.0])
    h, deviation = np.array([10.0, 14.0, 8.0]), np.full((2, 3), 1e-3) * [[1.0], [-1.0]]
    left = known.core.present((len(values) - 1) * SECOND // 50, h, np.zeros((1, 3)), deviation)[2]
    assert np.allclose(left, known.core.least_weights[0] * h**2 * is_open, rtol=0.1, atol=0.1)


def test_the_present_follows_a_reading_as_gaussian_variables_do():
    """Conditional mean and variance of jointly normal quantities, given a noisy one of them."""
    generator = np.random.default_rng(6)
    known = Beliefs(_unknowns(1))
    _hear(known, "cell", verified=True)
    nothing = [0.0]
    _read(known, 0, 0, 10.0, nothing)
    _read(known, 0, 1, 10.8, nothing)
    h, deviation = np.array([10.0, 12.0, 8.0]), generator.normal(size=(32, 3))
    deviation[:, 1] += deviation[:, 0]
    shift, share, left = known.core.present(SECOND, h, np.zeros((1, 3)), deviation)
    joint = deviation.T @ deviation / len(deviation)
    gain = joint[:, 0] / (joint[0, 0] + NOISE**2)
    right, either = known.core.weight[0], known.core.least_weights
    off = joint[:, 0] / (joint[0, 0] + NOISE**2 + (0.3 * 10.8) ** 2)  # if the cell is wrong
    assert np.allclose(shift, 0.8 * (right * gain + (1.0 - right) * off))
    taken = (either[0] * gain + either[1] * off) * joint[0] / np.diag(joint)
    assert np.allclose(share, taken)
    spread = either @ (np.outer([1.0, 0.0], gain) + np.outer([0.0, 1.0], off) - shift / 0.8) ** 2
    assert np.allclose(left, 0.8**2 * spread)


@pytest.mark.parametrize("refuted", [False, True])
def test_a_reading_is_stray_only_of_a_sensor_that_may_be_right(refuted):
    """One far reading among others leaves the tensions open where the sensor is known to lie."""
    known, generator = Beliefs(_unknowns(1)), np.random.default_rng(7)
    _hear(known, "cell")
    for k in range(50):
        off = 6.0 * (-1.0) ** k if refuted else 0.0
        _read(known, 0, 0.1 * k, 10.0 + off + NOISE * generator.normal(), [0.0])
    _read(known, 0, 5.0, 10.0, [0.0])
    assert (known.core.weight[0] < 1e-3) == refuted
    _read(known, 0, 5.1, 16.0, [0.0])
    h, nothing = np.array([10.0, 12.0, 8.0]), np.zeros((32, 3))
    left = known.core.present(51 * SECOND // 10, h, np.zeros((1, 3)), nothing)[2]
    open_for = known.core.least_weights[0] * (0.6 * h) ** 2
    assert np.allclose(left, open_for if refuted else 0.0)


def test_what_is_known_outlasts_a_restart_and_damage_is_refused():
    def fresh(*names):
        known = Beliefs(_unknowns(2))
        _hear(known, *names)
        return known

    known = fresh("a", "b")
    for k in range(10):
        _read(known, k % 2, k, 10.4, [1.0, -0.5])
    memory = json.loads(json.dumps(known.memory()))
    again = fresh("a", "b")
    again.restore(memory)
    assert np.array_equal(again.core.mean, known.core.mean)
    assert np.array_equal(again.core.covariance, known.core.covariance)
    assert np.array_equal(again.core.weight, known.core.weight)

    def together(more):  # two unknowns that differ together by more than either does
        both = np.eye(2, again.core.mean.shape[1])
        return (np.array(memory["covariance"]) + more * both.T @ (1.0 - np.eye(2)) @ both).tolist()

    damages = [
        {"mean": [[0.0]]},
        {"covariance": (-np.array(memory["covariance"])).tolist()},
        {"weight": [float("nan")] * 4},
        {"sensors": [["a", 0]]},
        {"sensors": [["a", "now"], ["b", 0]]},
        {"sensors": [["a", 10**30], ["b", 0]]},
        {"mean": np.full_like(again.core.mean, 1e300).tolist()},
        {"covariance": together(1e3)},
    ]
    for damage in damages:
        with pytest.raises((KeyError, TypeError, ValueError, OverflowError)):
            again.restore(memory | damage)
        assert np.array_equal(again.core.mean, known.core.mean)
    with pytest.raises(ValueError, match="unknowns"):
        fresh("a").restore(memory)
