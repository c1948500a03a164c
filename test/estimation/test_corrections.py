"""Corrections of the estimate by sensors: laws that hold for any of them, and what they achieve.

The truth is a simulated rig with contact cells fixed to its pulleys' surfaces.
"""

from typing import NamedTuple

import numpy as np
import pytest
from support.campaign import START, course_of, sine
from support.heard import heard
from support.places import ROBOT, ROBOTS

from cdrj_ros.estimation.changes import with_other_numbers
from cdrj_ros.estimation.group import Group
from cdrj_ros.estimation.sensors import sensors_of
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.foundation.arrays import Table
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.parameters import number_at
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.simulation.truth import simulate

HERTZ = 200
CELL = "upper/8"


class Run(NamedTuple):
    """Estimates beside the truth, from 5 s on."""

    error: Table
    stddev: Table
    status: Table
    live: LiveEstimator

    @property
    def within(self):
        """Share of the errors within two standard deviations."""
        return float(np.mean(np.abs(self.error) < 2.0 * self.stddev))


def _document(name, axes=None, **more):
    """A shipped robot with further keys, and further keys of all motors."""
    given, source = load_document(ROBOTS / f"{name}.yaml")
    document = {**given, **more}
    if axes:
        document["motors"] = [{**one, **axes} for one in document["motors"]]
    return prepare(build_robot(document, source))


def _truth(model, factors, seconds, share=0.4):
    """The rig with some numbers multiplied, all joints moving by a share of their ranges."""
    document = dict(model.robot.document)
    changed = {path: factor * number_at(document, path) for path, factor in factors.items()}
    robot = with_other_numbers(model, changed).robot if changed else model.robot
    time = np.arange(0.0, seconds, 1.0 / HERTZ)
    ramp = np.clip(time / 2.0, 0.0, 1.0)
    angles = []
    for k, joint in enumerate(robot.joints):
        span = joint.upper - joint.lower
        free = (share + 0.05) * span  # readings off by some degrees stay within the range
        middle = min(max(float(robot.reference_pose[k]), joint.lower + free), joint.upper - free)
        moves = middle + share * span * np.sin(2.0 * np.pi * (0.25, 0.4)[k % 2] * time + k)
        angles.append((1.0 - ramp) * robot.reference_pose[k] + ramp * moves)
    return simulate(robot, time, np.stack(angles, axis=1), None, 20.0, 4, allow_slack=True)


def _run(model, truth, readings, zeros=0.0, options=None):
    """Let the estimator hear readings of sensors by name at 50 Hz."""
    live, layout, outputs = LiveEstimator(model, options), model.layout, []
    joints = truth.joint_angle + zeros
    for k in range(len(truth.tension)):
        stamp = START + k * 10**9 // HERTZ
        for name, values in readings.items() if k % (HERTZ // 50) == 0 else ():
            if "/" in name:
                live.feed_tensions(stamp, [name], [float(values[k])], [])
            else:
                live.feed_efforts(stamp, [name], [float(values[k])])
        live.feed("motors", stamp, layout.motors, truth.motor_angle[k])
        outputs += live.feed("joints", stamp, layout.joints, joints[k])[1]
    outputs = [one for one in outputs if one.stamp_ns >= START + 5 * 10**9]
    at = [(one.stamp_ns - START) * HERTZ // 10**9 for one in outputs]
    tension, status = (
        np.array([getattr(o, key) for o in outputs]) for key in ("tension", "status")
    )
    stddev = np.array([o.stddev[: tension.shape[1]] for o in outputs if o.stddev is not None])
    return Run(tension - truth.tension[at], stddev, status, live)


def test_a_finger_with_a_fresh_file_is_known_by_the_torques_of_its_motors():
    """Zeros off by a degree, friction by 15 %, preloads by 8 %; gain 3 % and friction 5 % off."""
    generator = np.random.default_rng(0)
    model = _document("finger", {"effort_noise": 0.003})
    wrong = {"friction.mu_c": 1.15, "cables.deep.preload": 1.08, "cables.superficial.preload": 0.92}
    truth = _truth(model, wrong, 10.0)
    effort = truth.motor_effort
    turns = np.sign(np.gradient(truth.motor_angle, axis=0))
    said = 1.03 * effort - 0.05 * np.abs(effort).mean(axis=0) * turns
    said = said + generator.normal(0.0, 0.003, said.shape)
    readings = {name: said[:, k] for k, name in enumerate(model.layout.motors)}
    zeros = np.radians([1.0, -0.7])
    share = np.abs(truth.tension[5 * HERTZ :]).mean()
    with_them = _run(model, truth, readings, zeros)
    assert np.abs(with_them.error).mean() < 0.08 * share  # within 10 s of motion
    assert with_them.stddev.mean() < 0.15 * share
    assert with_them.within > 0.95
    verified = _run(_document("finger", {"effort_noise": 0.003, "effort_verified": True}), truth,
                    readings, zeros)  # fmt: skip
    good = verified.status == 0
    assert good.mean() > 0.8
    assert np.mean(np.abs(verified.error[good]) > 2.0 * verified.stddev[good]) < 0.05


def test_a_gain_that_was_fitted_is_known_as_well_as_its_file_states():
    """Neither better than a compared one, as motors grow warm, nor worse than by a data sheet."""
    path, gains = "motors.deep_motor.effort_scale", {}
    for stddev in (0.001, 0.03, 0.4):
        known = {"others": "exact", "parameters": [path], "stddev": [2.5 * stddev]}
        model = _document("finger", {"effort_scale": -2.5}, uncertainty=known)
        gains[stddev] = [one.gain for one in sensors_of(model).values() if one.axis >= 0]
    assert gains[0.001] == pytest.approx([0.02, 0.05, 0.05])
    assert gains[0.03] == pytest.approx([0.03, 0.05, 0.05])
    assert gains[0.4] == pytest.approx([0.05, 0.05, 0.05])


def test_cells_tell_the_tensions_of_a_platform_whose_pose_is_hardly_known():
    """A millimetre is some tens of newtons in its stiff cables, which the cells tell to 1 %."""
    generator = np.random.default_rng(1)
    model = _document("cdpr")
    truth = _truth(model, {}, 8.0, 0.02)
    cells = [f"{cable}/1" for cable in model.layout.cables]
    columns = [model.layout.elements.index(name) for name in cells]
    said = truth.tension[:, columns] + generator.normal(0.0, 0.1, (len(truth.tension), len(cells)))
    zeros = np.array([1e-3, -1e-3, 1e-3, 5e-3, 0.0, -5e-3])
    found = _run(model, truth, dict(zip(cells, said.T, strict=True)), zeros)
    assert (np.abs(found.error[:, columns]).mean(axis=0) < 0.01 * truth.tension[-1, columns]).all()
    assert found.within > 0.95
    assert np.mean(found.status == 0) > 0.95
    assert found.live.corrections is not None
    assert min(found.live.corrections.right.values()) > 0.9
    # zero and gain of a cell have their share of what the file leaves open: 3 % of 300 N
    (group,) = found.live.corrections.groups
    mean, _ = group.beliefs.moments()
    for name, column in zip(cells, columns, strict=True):
        bias, gain = (mean[k] for k in group.beliefs.errors_of(group.index[name]))
        read = truth.tension[5 * HERTZ :, column].mean()
        believed = (read - bias) / (1.0 + gain)
        assert read + found.error[:, column].mean() == pytest.approx(believed, abs=0.1)


@pytest.fixture
def renewed(monkeypatch):
    """Stamps at which a group's part of the present is renewed."""
    calls = []
    take = Group.take

    def noted(group, sample, *others):
        if (found := take(group, sample, *others)) is not None:
            calls.append(sample.stamp_ns)
        return found

    monkeypatch.setattr(Group, "take", noted)
    return calls


def test_sensors_that_read_at_different_times_cost_no_more_than_together(renewed):
    """The present is conditioned on all readings once in 20 ms, whenever they come."""
    model = _document("finger", {"effort_noise": 0.003})
    truth, motors = _truth(model, {}, 1.0), model.layout.motors
    live = LiveEstimator(model)
    for k in range(len(truth.tension)):
        stamp = START + k * 10**9 // HERTZ
        name = motors[k % len(motors)]
        live.feed_efforts(stamp, [name], [float(truth.motor_effort[k, k % len(motors)])])
        live.feed("motors", stamp, motors, truth.motor_angle[k])
        live.feed("joints", stamp, model.layout.joints, truth.joint_angle[k])
    assert len(live.corrections.right) == len(motors)
    assert len(renewed) == pytest.approx(50, abs=1)


def test_no_sample_of_a_hand_waits_for_more_than_one_of_its_groups(renewed):
    """Seven groups, each renewed once in ten samples; at the start, all are."""
    model = load_model("hand")
    live, robot, stamps = LiveEstimator(model), model.robot, START + 2_000_000 * np.arange(100)
    readings = robot.reference_motors, robot.reference_pose, np.ones(len(robot.motors))
    for _ in heard(live, stamps.tolist(), *(np.tile(one, (100, 1)) for one in readings)):
        pass
    groups, (start, *later) = len(live.corrections.groups), sorted(set(renewed))
    assert renewed.count(start) == groups == 7
    assert all(renewed.count(stamp) == 1 for stamp in later)
    assert len(later) == pytest.approx(10 * groups, abs=groups)


def test_a_joint_torque_sensor_corrects_what_no_motor_shows():
    given, source = load_document(ROBOT)
    document = dict(given)
    document["joints"] = [{**document["joints"][0], "effort_noise": 0.02}]
    model = prepare(build_robot(document, source))
    truth = _truth(model, {"cables.upper.preload": 0.9}, 12.0)
    generator = np.random.default_rng(2)
    said = truth.joint_effort[:, 0] + generator.normal(0.0, 0.02, len(truth.tension))
    alone, found = (_run(model, truth, readings) for readings in ({}, {"elbow": said}))
    assert np.abs(found.error).mean() < 0.7 * np.abs(alone.error).mean()
    assert found.within > 0.95
    assert found.live.corrections.right["elbow"] > 0.9


@pytest.fixture(scope="module")
def course():
    return course_of(load_model(ROBOT), 8.0, sine(0.3))


def _hear_cell(model, course, gain, **options):
    live = LiveEstimator(model, Options(**options))
    for k in range(0, len(course.angle), 4):
        stamp = START + k * 10**6
        if k % 20 == 0:
            live.feed_tensions(stamp, [CELL], [gain * float(course.tension[k, 7])], [0.05])
        live.feed("motors", stamp, ("winch",), course.angle[k, :1])
        live.feed("joints", stamp, ("elbow",), course.angle[k, 1:])
    return live


@pytest.mark.parametrize(("scale", "confirms"), [(1.0, True), (0.7, False)])
def test_a_spring_scale_that_says_the_same_confirms_a_sensor(scale, confirms, model, course):
    live = _hear_cell(model, course, 1.0)
    upper = model.robot.cables[0].preload
    live.set_preload({"upper": scale * upper})
    assert live.corrections.sensors[CELL].verified == confirms


def test_what_sensors_correct_adds_up(model, course):
    """Friction is the difference of the tensions, and no tension is negative."""
    live = _hear_cell(model, course, 0.6)
    sample = live.sample
    estimate = live.take(sample._replace(stamp_ns=sample.stamp_ns + 10**6))
    at = model.layout.element_before
    assert np.allclose(estimate.friction, estimate.tension[at + 1] - estimate.tension[at])
    force = np.sqrt(estimate.force_x**2 + estimate.force_y**2 + estimate.force_z**2)
    assert np.allclose(force, estimate.nodal_force)
    assert (estimate.tension >= 0.0).all()
