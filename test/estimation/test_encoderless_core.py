"""Joints without encoder in the compiled core: the results of the present kernels, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from support.motor_alone import motion, only_measured, truth_of, without_encoder

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.estimation.encoderless import EncoderlessEstimator
from cdrj_ros.estimation.estimator import Estimates
from cdrj_ros.estimation.motor_alone import MotorAlone

ROBOTS = [
    ("prototype", ("elbow",), {}),
    ("prototype", ("elbow",), {"load_drift": 0.01}),
    ("finger", ("pip",), {}),
    ("finger", ("mcp",), {"load_drift": 0.01}),
    ("finger", ("mcp", "pip"), {}),
    ("finger", ("mcp", "pip"), {"load_drift": 0.01}),
    ("davinci_jaw", ("jaw",), {"load_drift": 0.01}),
    ("prototype_positions", ("elbow",), {}),
    ("parallel", ("phi",), {}),
    ("exosuit", ("elbow",), {}),
    ("finger3d", ("abduction", "pip"), {}),
    ("wrist", ("jaw_1",), {"load_drift": 0.01}),
]


def same(one: Estimates, other: Estimates) -> bool:
    assert one.angles is not None
    assert other.angles is not None
    assert one.stddev is not None
    assert other.stddev is not None
    return all(
        a.tobytes() == b.tobytes()
        for a, b in (
            (one.values, other.values),
            (one.stddev, other.stddev),
            (one.angles.value, other.angles.value),
            (one.angles.stddev, other.angles.stddev),
        )
    )


@pytest.mark.parametrize("members", [0, 8])
@pytest.mark.parametrize(("name", "joints", "more"), ROBOTS)
def test_the_core_finds_what_the_kernels_find(
    name: str, joints: tuple[str, ...], more: dict[str, float], members: int
) -> None:
    model = without_encoder(name, *joints, **more)
    samples = motion(model, 800)
    _, efforts = truth_of(model, samples)
    efforts[300:310] = np.nan  # not heard
    efforts[400:500] += 3.0  # lost
    read = only_measured(model, samples)
    stamps = read.stamp_ns.copy()
    stamps[600:] += np.arange(200) * 10**6 - 5 * 10**6  # one stamp twice, then another rate
    read = Samples(stamps, read.motor_angle, read.joint_angle)
    one = EncoderlessEstimator(model, members)
    other = MotorAlone(model, members)
    assert same(one.run(read, efforts), other.run(read, efforts))
    assert one.state.tobytes() == other.state.tobytes()
    for both in (one, other):
        both.look_ahead()
    assert same(one.run(read.part(slice(600, 700)), efforts[600:700]),
                other.run(read.part(slice(600, 700)), efforts[600:700]))
    for both in (one, other):
        both.look_back()
    assert one.state.tobytes() == other.state.tobytes()
    assert same(one.run(read.part(slice(700, 800)), efforts[700:]),
                other.run(read.part(slice(700, 800)), efforts[700:]))
    for both in (one, other):
        both.reset()
    assert same(one.run(read.part(slice(0, 30)), efforts[:30]),
                other.run(read.part(slice(0, 30)), efforts[:30]))
