"""A joint that moves by its dynamics under the cables."""

from dataclasses import replace

import numpy as np
import pytest
from support.energy import energy

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.laws import elasticity_of, strain_at
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, sine
from cdrj_ros.simulation.truth import simulate

LOAD = make_load("rolling", 0.3)
STILL = np.zeros((4_001, 1))
TIME = np.arange(4_001) / 1000.0


def _total_energy(robot, truth, load):
    """Kinetic, gravitational and elastic energy [J] of every tenth sample, without the ends."""
    angle = truth.joint_angle[:, 0]
    speed = np.gradient(angle, truth.time)
    total = energy(load, angle, speed)
    model = prepare(robot)
    at = np.arange(10, angle.size - 10, 10)
    stored = np.zeros(at.size)
    for n, k in enumerate(at):
        length = shape_at(model, truth.joint_angle[k]).length
        element = 0
        for cable in robot.cables:
            for _ in cable.element_names:
                t = truth.tension[k, element]
                law = elasticity_of(cable)
                material = length[element] / (1.0 + strain_at(law, t))
                taken = t / law.bedding_tension  # integral of t d(eps) of (E21)
                bedding = law.bedding_strain * law.bedding_tension
                stored[n] += material * (
                    0.5 * t**2 / cable.axial_stiffness
                    + bedding * (np.log1p(taken) - taken / (1.0 + taken))
                )
                element += 1
    return total[at] + stored


@pytest.mark.parametrize("bedding", [0.0, 0.002])
def test_a_frictionless_swing_keeps_its_energy(robots, bedding):
    robot = robots.prototype("none")
    cables = [replace(one, bedding_strain=bedding, bedding_tension=20.0) for one in robot.cables]
    robot = replace(robot, cables=tuple(cables))
    truth = simulate(robot, TIME, motor_angle=STILL, load=LOAD, cells=1, start=0.03)
    total = _total_energy(robot, truth, LOAD)
    swung = energy(LOAD, truth.joint_angle[:, 0], np.zeros(TIME.size))
    assert np.ptp(total) < 0.01 * np.ptp(swung)
    drift = np.polyfit(np.arange(total.size), total, 1)[0] * total.size
    assert abs(drift) < 1e-3 * np.ptp(swung)


def test_friction_and_damping_only_dissipate_energy(robots):
    robot = robots.prototype()
    for load in (LOAD, make_load("rolling", 0.3, damping=0.1)):
        truth = simulate(robot, TIME, motor_angle=STILL, load=load, cells=2, start=0.03)
        total = _total_energy(robot, truth, load)
        assert total[-1] < total[0]
        bristles = 0.02 * (total[0] - total[-1])  # they return some energy within a swing
        assert np.diff(total).max() < bristles


def test_forward_dynamics_return_the_motion_that_was_balanced(robots):
    robot = robots.prototype()
    time = np.arange(3_001) / 1000.0
    angle = sine(0.3, 0.5)(time - 0.2)
    torque = LOAD.torque(*differences(time, angle))
    inverse = simulate(robot, time, angle, torque, cells=4, motor_speed=1e3)
    forward = simulate(robot, time, motor_angle=inverse.motor_angle, load=LOAD, cells=4)
    assert np.abs(forward.joint_angle - inverse.joint_angle).max() < 2e-3
    assert np.abs(forward.tension - inverse.tension).mean() < 0.2


def test_a_joint_that_runs_out_of_its_range_is_refused_with_the_time(robots):
    with pytest.raises(UsageError, match=r"elbow leaves its range .* at t = "):
        simulate(robots.prototype("none"), TIME, motor_angle=3.0 * TIME, load=LOAD, cells=1)
