"""Counts of encoders in a fit: they make estimates noisy, which no fit may lower by soft cables."""

from functools import cache

import numpy as np
import pytest
import yaml
from support.fingers import finger, hand

from cdrj_ros.estimation.conditioner import count_of
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.identification.fit import sentences
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.parts import fit_parts
from cdrj_ros.identification.reading_errors import reading_error
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Sensor
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.motion import random
from cdrj_ros.simulation.truth import simulate

RATE, SECONDS = 200.0, 30.0
COUNT = 2.0 * np.pi / 4096


def test_the_count_of_readings_is_found_where_there_is_one():
    smooth = np.cumsum(np.random.default_rng(0).normal(0.0, 3e-3, 500))
    assert count_of(np.round(smooth / COUNT) * COUNT) == pytest.approx(COUNT)
    assert count_of(smooth) == 0.0
    assert count_of(np.zeros(100)) == 0.0
    later = np.concatenate([np.zeros(30_000), smooth])
    assert count_of(np.round(later / COUNT) * COUNT) == pytest.approx(COUNT), "after a long rest"
    to_and_fro = np.abs(np.arange(500) % 200 - 100)
    assert count_of(0.003 * to_and_fro) == 0.0, "a motion at a constant speed"
    assert count_of(0.003 * np.floor(0.3 * to_and_fro)) == pytest.approx(0.003)


def test_a_reading_errs_by_its_count_and_its_noise_in_the_unit_of_the_axis():
    sensor = Sensor(scale=-0.5, resolution=0.012, noise=0.003)
    wanted = 0.5 * np.hypot(0.012 / np.sqrt(12.0), 0.003)
    assert reading_error(sensor, np.zeros(3)) == pytest.approx(wanted)
    assert reading_error(Sensor(), np.arange(12.0) ** 2) == pytest.approx(1.0 / np.sqrt(12.0))


@cache
def fitted_with(count):
    """A finger that is as its file says, moved at random, with joints read in counts [rad]."""
    robot = hand(finger("a"))
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    angles = np.stack([random(0.4, 0.5, seed)(time - 0.5) for seed in (3, 4)], axis=1) + 0.5
    motors = follow_joints(prepare(robot), angles).motor_angle
    truth = simulate(robot, time, angles, motor_angle=motors, allow_slack=True)
    stamps = 1_700_000_000_000_000_000 + np.round(time * 1e9).astype(np.int64)
    noise = np.random.default_rng(5).normal(0.0, 0.008, truth.motor_effort.shape)

    def series(names, table):
        columns = np.ascontiguousarray(table.T)
        return {name: Series(stamps, stamps, one) for name, one in zip(names, columns, strict=True)}

    read = np.round(truth.joint_angle / count) * count
    recorded = Recorded(
        "motion",
        series([one.name for one in robot.motors], truth.motor_angle),
        series([one.name for one in robot.joints], read),
        series([f"effort/{one.name}" for one in robot.motors], truth.motor_effort + noise),
    )
    text = yaml.safe_dump(dict(robot.document))
    (fit,) = fit_parts(robot, text, [recorded])
    return fit


def test_counts_of_the_joints_make_no_cable_soft_and_no_drum_slip():
    fit = fitted_with(COUNT)
    off = dict(zip((one.name for one in fit.found.unknowns), fit.found.values, strict=True))
    stiffness = [off[f"cables.a_{k}.axial_stiffness"] for k in range(2)]
    assert np.abs(stiffness).max() < 1.5, off
    assert sum(value**2 for value in off.values()) < 10.0
    assert fit.found.drums
    assert not [one for one in sentences(fit.found.drums) if "The cable slips" in one]


def test_readings_in_counts_never_make_a_fit_surer_than_fine_ones():
    coarse, fine = fitted_with(COUNT).found, fitted_with(1e-7).found
    assert np.all(coarse.stddev > 0.9 * fine.stddev)
    assert coarse.stddev.mean() > fine.stddev.mean()
