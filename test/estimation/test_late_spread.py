"""An ensemble whose kernels are compiled while the estimator already runs."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy

import numpy as np
import pytest

from cdrj_ros.conditioning.samples import Sample, Samples
from cdrj_ros.estimation import late_spread
from cdrj_ros.estimation.options import Options
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.model.status import UNSURE
from cdrj_ros.robot.reader import build_robot

COUNT = 400
"""Samples of a run."""


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model("prototype")


@pytest.fixture(scope="module")
def readings(model: Model, recorded: Callable[[Model, int], Samples]) -> Samples:
    return recorded(model, 15)


def _late(model: Model, options: Options | None = None) -> LiveEstimator:
    live = LiveEstimator(model, options)
    live.postpone_spread()
    return live


def _take(live: LiveEstimator, sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """All numbers of a sample, and its standard deviations."""
    estimate, stddev = live.take(sample)
    assert stddev is not None
    values = estimate.values.copy()
    live.finish()
    return values, stddev.copy()


@pytest.mark.parametrize("joined", [0, 1, 7, 300])
@pytest.mark.parametrize("robot", ["prototype", "finger3d"])
def test_after_joining_every_number_is_that_of_an_ensemble_from_the_start(
    robot: str, joined: int
) -> None:
    model = load_model(robot)
    motor = np.array([motor.reference_angle for motor in model.robot.motors])
    joint = np.array([joint.reference_angle for joint in model.robot.joints])
    swing = 0.02 * np.sin(0.02 * np.arange(COUNT))[:, None]
    stamps = 1_000_000_000 + 1_000_000 * np.arange(COUNT)
    samples = Samples(stamps, motor + swing, joint + 0.1 * swing)
    usual, late = LiveEstimator(model), _late(model)
    status = model.layout.status
    for k in range(COUNT):
        if k == joined:
            late.add_spread()
        (values, stddev), (early, unknown) = (_take(live, samples.at(k)) for live in (usual, late))
        if k < joined:
            assert np.isposinf(unknown).all()
            flags = early[status].astype(int)
            assert ((flags & UNSURE != 0) | (flags == values[status].astype(int))).all()
            assert (flags & UNSURE != 0).any()
            early[status] = values[status]
        else:
            assert unknown.tobytes() == stddev.tobytes()
        assert early.tobytes() == values.tobytes()
    assert usual.spread is not None
    assert late.spread is not None
    assert usual.spread.states.tobytes() == late.spread.states.tobytes()


def test_catching_up_can_be_spread_over_several_calls(model: Model, readings: Samples) -> None:
    usual, late = LiveEstimator(model), _late(model)
    calls = 0
    for k in range(COUNT):
        if k >= 200 and late.spread_is_late:
            calls += 1
            done = [late.add_spread(0.0) for _ in range(5)]  # one sample each
            assert done[-1] is not late.spread_is_late
        late_before = late.spread_is_late
        (_, stddev), (_, found) = (_take(live, readings.at(k)) for live in (usual, late))
        assert late_before == bool(np.isposinf(found).all())
        if not late_before:
            assert found.tobytes() == stddev.tobytes()
    assert calls == 50  # 200 samples and one more with every call, five at a time
    assert late.add_spread()


def test_predicted_samples_are_not_kept(model: Model, readings: Samples) -> None:
    usual, late = LiveEstimator(model), _late(model)
    for k in range(COUNT):
        sample = readings.at(k)
        for live in (usual, late):
            _take(live, sample)
        ahead = sample._replace(stamp_ns=sample.stamp_ns + 500_000, predicted=True)
        (_, stddev), (_, unknown) = (_take(live, ahead) for live in (usual, late))
        if k < 100:
            assert np.isposinf(unknown).all()
        else:
            assert unknown.tobytes() == stddev.tobytes()
        if k == 99:
            late.add_spread()


@pytest.mark.parametrize("what", ["reset", "numbers", "suspend"])
def test_what_makes_an_ensemble_begin_anew_makes_it_forget_what_it_missed(
    what: str, model: Model, readings: Samples
) -> None:
    usual, late = LiveEstimator(model), _late(model)
    for k in range(2 * COUNT):
        if k == COUNT:
            for live in (usual, late):
                if what == "reset":
                    live.reset()
                elif what == "numbers":
                    live.set_numbers({"friction.mu_c": 0.1})
                else:
                    live.suspend()
        if k == COUNT + 50:
            late.add_spread()
        (_, stddev), (_, found) = (_take(live, readings.at(k)) for live in (usual, late))
        if what == "suspend":  # what the members knew then is lost: they begin anew
            continue
        if k >= COUNT + 50:
            assert found.tobytes() == stddev.tobytes()
    assert np.isfinite(found).all()


def test_of_too_many_samples_the_first_are_forgotten(
    model: Model, readings: Samples, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(late_spread, "MOST", 100)
    late, usual = _late(model), LiveEstimator(model)
    for k in range(250):
        _take(late, readings.at(k))
        if k >= 200:
            _take(usual, readings.at(k))
    late.add_spread()
    assert late.spread is not None
    assert usual.spread is not None
    assert (late.spread.stamps == usual.spread.stamps).all()
    assert np.isfinite(_take(late, readings.at(250))[1]).all()


def test_an_estimator_that_corrects_its_ensemble_or_has_none_does_not_wait_for_it(
    model: Model,
) -> None:
    document = deepcopy(dict(model.robot.document))
    for joint in document["joints"]:
        joint["measured"] = False
    alone = prepare(build_robot(document, "without encoder"))
    for robot, options in (
        (model, Options(tension_sensors=True)),
        (model, Options(uncertainty=False)),
        (alone, Options()),
    ):
        live = _late(robot, options)
        assert not live.spread_is_late
        assert live.add_spread()
    assert live.alone is not None
