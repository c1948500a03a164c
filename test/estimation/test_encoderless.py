"""Joints without encoder, from the angles and efforts of the motors."""

from copy import deepcopy
from dataclasses import replace
from time import process_time

import numpy as np
import pytest
from support.motor_alone import MS, NOISE, START, motion, only_measured, truth_of, without_encoder
from support.places import ROBOT

from cdrj_ros.estimation.encoderless import (
    EFFORT_AGE_NS,
    EncoderlessEstimator,
    RecentEfforts,
    efforts_at,
)
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.inspection.motors import determined_joints
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import build_robot


@pytest.fixture(scope="module")
def prototype():
    return without_encoder("prototype", "elbow")


@pytest.mark.parametrize(
    ("name", "joints", "most"),
    [("prototype", ("elbow",), 3e-3), ("finger", ("pip",), 0.02), ("finger", ("mcp", "pip"), 0.02)],
)
def test_efforts_give_the_angle_of_a_joint_without_encoder(name, joints, most):
    model = without_encoder(name, *joints)
    samples = motion(model)
    truth, efforts = truth_of(model, samples)
    estimates = EncoderlessEstimator(model, members=8).run(only_measured(model, samples), efforts)
    angles = estimates.angles
    assert angles.names == joints
    error = angles.value - samples.joint_angle[:, list(model.robot.unmeasured)]
    settled = slice(300, None)
    assert np.sqrt((error[settled] ** 2).mean()) < most
    assert np.mean(np.abs(error[settled]) < 2.0 * angles.stddev[settled]) > 0.8
    effort = (
        estimates.values[:, model.layout.motor_effort] - truth.values[:, model.layout.motor_effort]
    )
    assert np.sqrt((effort[settled] ** 2).mean()) < 5.0 * NOISE


def test_without_efforts_there_are_no_numbers_and_the_next_effort_starts_anew(prototype):
    samples = motion(prototype, 60)
    _, efforts = truth_of(prototype, samples)
    efforts[20:40] = np.nan
    read = only_measured(prototype, samples)
    found = EncoderlessEstimator(prototype, members=8).run(read, efforts)
    layout = prototype.layout
    assert np.all(np.isnan(found.values[20:40, layout.tension]))
    assert np.all(found.values[20:40, layout.status] == INVALID)
    assert np.all(np.isnan(found.angles.value[20:40]))
    again = EncoderlessEstimator(prototype, members=8).run(read.part(slice(40, 60)), efforts[40:])
    assert found.values[40:].tobytes() == again.values.tobytes()


def test_the_live_estimator_says_that_it_hears_no_effort_and_refuses_what_needs_encoders(prototype):
    samples = motion(prototype, 3)
    live = LiveEstimator(prototype)
    for k in range(3):
        live.feed("motors", int(samples.stamp_ns[k]), ["winch"], samples.motor_angle[k])
    output = live.take(only_measured(prototype, samples).at(2)._replace(stamp_ns=START + 10**9))
    assert live.encoderless.lacks_efforts
    assert output.angles is None
    assert not output.solved
    assert np.all(output.status == INVALID)
    assert np.all(output.tension == 0.0)
    live.feed_efforts(START + 2 * 10**9, ["winch"], [0.0])
    live.take(only_measured(prototype, samples).at(2)._replace(stamp_ns=START + 2 * 10**9))
    assert not live.encoderless.lacks_efforts
    with pytest.raises(UsageError, match="elbow has no encoder"):
        live.tare()


def test_efforts_are_interpolated_and_unknown_far_from_any_reading():
    stamps = START + 10 * MS * np.arange(3)
    series = Series(stamps, stamps, np.array([0.0, 1.0, 4.0]))
    at = START + np.array(
        [-EFFORT_AGE_NS - 1, 5 * MS, 10 * MS, 15 * MS, 20 * MS + EFFORT_AGE_NS + 1]
    )
    found = efforts_at(at, ("one", "other"), {"one": series})
    assert np.allclose(found[1:4, 0], [0.5, 1.0, 2.5])
    assert np.all(np.isnan(found[[0, 4], 0]))
    assert np.all(np.isnan(found[:, 1]))
    heard = RecentEfforts({"one": 0, "other": 0})
    for stamp, value in zip(stamps.tolist(), series.value.tolist(), strict=True):
        heard.add(stamp, ["one", "strange"], [value, 1.0])
    one_by_one = np.array([heard.at(int(stamp)) for stamp in at])
    assert np.allclose(one_by_one, np.column_stack([found[:, 0], found[:, 1]]), equal_nan=True)


def test_a_joint_that_no_winch_feels_is_not_determined():
    one = determined_joints(without_encoder("prototype", "elbow"))
    assert 0.0 < one["elbow"] < 1e-3
    both = determined_joints(without_encoder("finger", "mcp", "pip"))
    assert len(both) == 2
    assert all(0.0 < stddev < 0.05 for stddev in both.values())
    document = deepcopy(dict(without_encoder("finger", "mcp", "pip").robot.document))
    document["joints"].append({"name": "idle", "range": [-1.0, 1.0], "measured": False})
    beside = determined_joints(prepare(build_robot(document, "idle")))
    assert beside == {**{name: pytest.approx(both[name]) for name in both}, "idle": float("inf")}
    document = deepcopy(dict(without_encoder("finger", "pip").robot.document))
    document["cables"] = [c for c in document["cables"] if c["name"] == "superficial"]
    document["motors"] = [m for m in document["motors"] if m["name"] == "superficial_motor"]
    alone = determined_joints(prepare(build_robot(document, "cut")))
    assert alone == {"pip": float("inf")}
    assert determined_joints(load_model(ROBOT)) == {}


def test_members_follow_the_estimate_and_search_nothing():
    """32 members of uncertain numbers, one in turn at every sample, cost a few estimates."""
    robot = load_model("finger").robot
    joints = tuple(replace(one, measured=one.name != "pip") for one in robot.joints)
    model = prepare(replace(robot, joints=joints))
    time = 0.002 * np.arange(1000)
    bent = np.radians(35.0 + 25.0 * np.sin(2.0 * np.pi * time))
    motors = np.outer(bent, [14.0 / 6.0, 9.0 / 6.0, -16.0 / 6.0])  # arms over the drums' radius
    samples = Samples(START + 2 * MS * np.arange(1000), motors, np.stack([bent, bent], axis=1))
    _, efforts = truth_of(model, samples)
    read, taken = only_measured(model, samples), []
    for members in (0, 32):
        estimator = EncoderlessEstimator(model, members)
        estimator.run(read.part(slice(0, 200)), efforts[:200])
        before = process_time()
        estimator.run(read.part(slice(200, 1000)), efforts[200:])
        taken.append(process_time() - before)
    assert taken[1] < 20.0 * taken[0]


def test_bad_arguments_are_refused(prototype):
    with pytest.raises(ValueError, match="has an encoder"):
        EncoderlessEstimator(load_model(ROBOT))
    with pytest.raises(ValueError, match="even"):
        EncoderlessEstimator(prototype, members=3)
    samples = only_measured(prototype, motion(prototype, 5))
    with pytest.raises(ValueError, match="shape"):
        EncoderlessEstimator(prototype, members=0).run(samples, np.zeros((5, 2)))
