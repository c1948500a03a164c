"""The simulated rig: truth with contact cells beside the lumped estimator."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.simulation.assembly import Truth, divide_contacts
from cdrj_ros.simulation.follow import follow_joints
from cdrj_ros.simulation.sensors import Encoder, read_cells, read_encoder, reading_times
from cdrj_ros.simulation.truth import simulate

ROBOT = load_robot(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")


def test_contact_cells_give_the_lumped_tensions_element_by_element(truth: Truth) -> None:
    model = prepare(ROBOT)
    stamps = 1 + np.round(truth.time * 1e9).astype(np.int64)
    samples = Samples(stamps, truth.motor_angle, truth.joint_angle)
    _, estimates = run(model, initial_state(model), samples)
    error = np.abs(estimates.values[:, model.layout.tension] - truth.tension)
    relative = (error / truth.tension).mean(axis=0)
    assert relative.mean() < 0.001
    assert relative.max() < 0.002
    assert error.max() < 1.0
    assert np.percentile(error, 99.5) < 0.5


def test_contact_cells_of_a_stiffening_cable_give_the_lumped_tensions() -> None:
    cables = [replace(one, bedding_strain=0.003, bedding_tension=15.0) for one in ROBOT.cables]
    robot = replace(ROBOT, cables=tuple(cables))
    time = np.arange(3_000) / 500.0
    angle = 0.3 * np.sin(2.0 * np.pi * 0.1 * time)
    truth = simulate(robot, time, angle, np.zeros(3_000), motor_speed=20.0, cells=4)
    stamps = 1 + np.round(truth.time * 1e9).astype(np.int64)
    samples = Samples(stamps, truth.motor_angle, truth.joint_angle)
    found = {}
    for name, one in (("its own law", robot), ("linear", ROBOT)):
        model = prepare(one)
        _, estimates = run(model, initial_state(model), samples)
        error = np.abs(estimates.values[:, model.layout.tension] - truth.tension)
        found[name] = float((error / truth.tension).mean())
    assert found["its own law"] < 0.003
    assert found["linear"] > 0.02


def test_a_sample_takes_the_memory_of_its_truth_and_not_of_all_contact_cells() -> None:
    """An hour at 1 kHz with the cells of the prototype would take 25 GB."""
    samples = 10_000
    time = np.arange(samples) / 1000.0
    angles = follow_joints(prepare(ROBOT), 0.1 * np.sin(time)[:, None])
    tracemalloc.start()
    truth = simulate(
        ROBOT, time, 0.1 * np.sin(time)[:, None], motor_angle=angles.motor_angle, cells=8
    )
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    kept = sum(one.nbytes for one in vars(truth).values() if isinstance(one, np.ndarray))
    states = 8 * prepare(divide_contacts(ROBOT, 8)).state_size * samples
    assert kept < peak < kept + 0.25 * states


def test_the_joint_is_balanced_at_every_sample(truth: Truth) -> None:
    angle = truth.joint_angle[:, 0]
    # where the joint waits for the motor its torque is that of the phase at which it waits
    moving = np.diff(angle, prepend=angle[0] - 1.0) != 0.0
    slow = RollingLoad().torque(angle, np.zeros_like(angle), np.zeros_like(angle))
    assert np.abs(truth.joint_effort[:, 0] - slow)[moving].max() < 0.05


def test_the_motor_never_turns_faster_than_it_can(truth: Truth) -> None:
    speed = np.abs(np.diff(truth.motor_angle[:, 0])) / np.diff(truth.time)
    assert speed.max() <= 5.0 * (1.0 + 1e-9)


def test_hysteresis_costs_work_in_every_cycle(truth: Truth) -> None:
    cycle = slice(2_500, 12_501)
    angle, effort = truth.motor_angle[cycle, 0], truth.motor_effort[cycle, 0]
    joint, torque = truth.joint_angle[cycle, 0], truth.joint_effort[cycle, 0]
    put_in = -_integral(effort, angle) - _integral(torque, joint)
    assert put_in > 0.1


def _integral(y: np.ndarray, x: np.ndarray) -> float:
    """Integral by the trapezoidal rule."""
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)))


def test_cells_do_not_change_the_geometry() -> None:
    lumped, fine = prepare(ROBOT), prepare(divide_contacts(ROBOT, 5))
    for angle in (-0.5, 0.0, 0.6):
        pose = np.array([angle])
        whole = shape_at(lumped, pose).length.sum()
        assert shape_at(fine, pose).segment.sum() == pytest.approx(whole, rel=1e-12)


def test_a_torque_that_no_cable_can_balance_is_refused() -> None:
    time = np.arange(100) / 1000.0
    with pytest.raises(UsageError, match="no winch angle balances"):
        simulate(ROBOT, time, np.zeros(100), np.full(100, 1e6), cells=2)


def test_an_encoder_counts_at_its_rate_and_phase() -> None:
    encoder = Encoder(100, 50.0, 0.004)
    times = reading_times(2.0, 3.0, encoder.rate, encoder.phase_s)
    assert times[0] == pytest.approx(2.004)
    assert np.diff(times) == pytest.approx(0.02)
    truth_time = np.linspace(0.0, 4.0, 4001)
    read = read_encoder(encoder, times, truth_time, truth_time)
    counts = read / (2.0 * np.pi / 100)
    assert counts == pytest.approx(np.round(counts))
    assert np.abs(read - times).max() <= np.pi / 100 + 1e-12


def test_load_cells_have_the_noise_and_the_steps_that_they_claim() -> None:
    time = np.linspace(0.0, 1.0, 20_001)
    values = np.stack([np.full_like(time, 10.0), np.full_like(time, -3.0)], axis=1)
    read = read_cells(values, time, time, 0.1, 2.0**-10, np.random.default_rng(3))
    assert read.std(axis=0) == pytest.approx(0.1, rel=0.03)
    assert read.mean(axis=0) == pytest.approx([10.0, -3.0], abs=0.005)
    assert np.array_equal(read, np.round(read * 2**10) / 2**10)
