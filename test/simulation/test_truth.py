"""The simulated rig: truth with contact cells beside the lumped estimator."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from support.places import PROTOTYPE

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.simulation.assembly import divide_contacts
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.truth import simulate

ROBOT = load_robot(PROTOTYPE)


def test_contact_cells_of_a_stiffening_cable_give_the_lumped_tensions():
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


ONES = np.ones(4)


@pytest.mark.parametrize(
    ("time", "angle", "words"),
    [
        ([0.0, 0.1, 0.1, 0.2], 0.1 * ONES, "time must be finite, increase"),
        ([0.3, 0.2, 0.1, 0.0], 0.1 * ONES, "time must be finite, increase"),
        ([0.0, 0.1, np.nan, 0.2], 0.1 * ONES, "time must be finite, increase"),
        ([], [], "time must be finite, increase"),
        ([0.0, 0.1, 0.2, 0.3], [0.0, np.nan, 0.0, 0.0], "joint_angle must be finite"),
        ([0.0, 0.1, 0.2, 0.3], 30.0 * ONES, r"elbow at 30 is outside of its range \[-0.6981"),
        ([0.0, 0.1, 0.2, 0.3], ONES[:3], "joint_angle must have the shape"),
    ],
)
def test_a_motion_that_is_none_is_refused_in_a_line(time, angle, words):
    with pytest.raises(UsageError, match=words):
        simulate(ROBOT, np.array(time), np.array(angle))


def test_a_sample_takes_the_memory_of_its_truth_and_not_of_all_contact_cells():
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
