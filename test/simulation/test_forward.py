"""A joint that moves by its dynamics under the cables."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace as Robots

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.elasticity import elasticity_of, strain_at
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.description import Robot
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.follow import follow_joints
from cdrj_ros.simulation.load import Load, energy, make_load, weight
from cdrj_ros.simulation.motion import differences, sine
from cdrj_ros.simulation.truth import simulate

LOAD = make_load("rolling", 0.3)
STILL = np.zeros((4_001, 1))
TIME = np.arange(4_001) / 1000.0


def _total_energy(robot: Robot, truth: Truth, load: Load) -> np.ndarray:
    """Kinetic, gravitational and elastic energy [J] of every tenth sample, without the ends."""
    angle = truth.joint_angle[:, 0]
    speed = np.gradient(angle, truth.time)
    total = energy(load.coefficients(), angle, speed)
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
def test_a_frictionless_swing_keeps_its_energy(robots: Robots, bedding: float) -> None:
    robot = robots.prototype("none")
    cables = [replace(one, bedding_strain=bedding, bedding_tension=20.0) for one in robot.cables]
    robot = replace(robot, cables=tuple(cables))
    truth = simulate(robot, TIME, motor_angle=STILL, load=LOAD, cells=1, start=0.03)
    total = _total_energy(robot, truth, LOAD)
    swung = energy(LOAD.coefficients(), truth.joint_angle[:, 0], np.zeros(TIME.size))
    assert np.ptp(total) < 0.01 * np.ptp(swung)
    drift = np.polyfit(np.arange(total.size), total, 1)[0] * total.size
    assert abs(drift) < 1e-3 * np.ptp(swung)


def test_the_amplitude_decreases_only_with_friction(
    robots: Robots,
) -> None:
    def amplitudes(robot: Robot) -> tuple[float, float]:
        angle = simulate(
            robot,
            TIME,
            motor_angle=STILL,
            load=LOAD,
            cells=1,
            start=0.03,
        ).joint_angle[:, 0]
        return float(np.ptp(angle[:500])), float(np.ptp(angle[-500:]))

    early, late = amplitudes(robots.prototype("none"))
    assert late == pytest.approx(early, rel=1e-3)
    early, late = amplitudes(robots.prototype())
    assert late < 0.9 * early


def test_friction_and_damping_only_dissipate_energy(robots: Robots) -> None:
    robot = robots.prototype()
    for load in (LOAD, make_load("rolling", 0.3, damping=0.1)):
        truth = simulate(robot, TIME, motor_angle=STILL, load=load, cells=2, start=0.03)
        total = _total_energy(robot, truth, load)
        assert total[-1] < total[0]
        bristles = 0.02 * (total[0] - total[-1])  # they return some energy within a swing
        assert np.diff(total).max() < bristles


def test_a_damped_joint_settles_where_the_balanced_rig_would_hold_it(
    robots: Robots,
) -> None:
    robot = robots.prototype("none")
    wound = 0.4
    load = make_load("rolling", 0.3, damping=2.0)
    truth = simulate(robot, TIME, motor_angle=STILL + wound, load=load, cells=1, start=0.06)
    rest = float(truth.joint_angle[-1, 0])
    assert abs(truth.joint_angle[-1, 0] - truth.joint_angle[-500, 0]) < 1e-7
    few = np.arange(50) / 1000.0
    needed = np.full(50, weight(load.coefficients(), np.array([rest]))[0])
    held = simulate(robot, few, np.full(50, rest), needed, cells=1)
    np.testing.assert_allclose(held.motor_angle[:, 0], wound, atol=1e-6)


def test_forward_dynamics_return_the_motion_that_was_balanced(
    robots: Robots,
) -> None:
    robot = robots.prototype()
    time = np.arange(3_001) / 1000.0
    course = sine(0.3, 0.5, 0.2)(time)
    torque = LOAD.torque(*differences(time, course.angle))
    inverse = simulate(robot, time, course.angle, torque, cells=4, motor_speed=1e3)
    forward = simulate(robot, time, motor_angle=inverse.motor_angle, load=LOAD, cells=4)
    assert np.abs(forward.joint_angle - inverse.joint_angle).max() < 2e-3
    assert np.abs(forward.tension - inverse.tension).mean() < 0.2


def test_a_joint_released_in_equilibrium_stays_there(robots: Robots) -> None:
    for robot in (robots.prototype(), robots.prototype("none")):
        angle = simulate(robot, TIME[:500], motor_angle=STILL[:500], load=LOAD, cells=4).joint_angle
        assert np.ptp(angle) < 1e-9


def test_the_step_does_not_matter(robots: Robots) -> None:
    ends = []
    for rate in (1000.0, 4000.0):
        time = np.arange(round(2.0 * rate) + 1) / rate
        truth = simulate(
            robots.prototype("none"),
            time,
            motor_angle=np.zeros((time.size, 1)),
            load=LOAD,
            cells=1,
            start=0.03,
        )
        ends.append(truth.joint_angle[:: round(rate / 1000.0), 0])
    assert np.abs(ends[0] - ends[1]).max() < 0.05 * 0.03


def test_a_joint_without_payload_is_solved_as_well(robots: Robots) -> None:
    light = make_load("rolling", 0.0)
    truth = simulate(
        robots.prototype(),
        TIME[:1000],
        load=light,
        motor_angle=STILL[:1000],
        cells=4,
        start=0.02,
    )
    assert np.abs(truth.imbalance).max() < 1e-6
    assert np.abs(truth.joint_angle).max() < 0.05


def test_a_hoist_lifts_its_weight_and_the_rope_carries_it(robots: Robots) -> None:
    robot = robots.hoist()
    time = np.arange(2_001) / 1000.0
    height = sine(0.2, 0.5, 0.2)(time).angle
    load = make_load("lift", 2.0, damping=40.0)
    motors = follow_joints(prepare(robot), height[:, None]).motor_angle + 0.05
    truth = simulate(robot, time, motor_angle=motors, load=load, cells=4)
    assert np.abs(truth.joint_angle[:, 0] - height).max() < 5e-3
    lifted = load.torque(*differences(time, truth.joint_angle[:, 0]))
    np.testing.assert_allclose(truth.tension[10:-10, 1], lifted[10:-10], rtol=0.02)


def test_one_joint_of_several_may_be_free(robots: Robots) -> None:
    time = TIME[:1000]
    load = make_load("pendulum", 0.05)
    motors = np.zeros((1000, 2))
    truth = simulate(
        robots.finger(),
        time,
        motor_angle=motors,
        load=load,
        joint=1,
        cells=4,
        start=0.02,
    )
    assert not truth.joint_angle[:, 0].any()
    assert np.ptp(truth.joint_angle[:, 1]) > 1e-3


def test_a_load_that_no_preload_holds_is_refused(robots: Robots) -> None:
    with pytest.raises(UsageError, match="hold the load in any pose of elbow"):
        simulate(
            robots.prototype(), TIME, motor_angle=STILL, load=make_load("rolling", 300.0), cells=1
        )


def test_a_joint_that_runs_out_of_its_range_is_refused_with_the_time(
    robots: Robots,
) -> None:
    with pytest.raises(UsageError, match=r"elbow leaves its range .* at t = "):
        simulate(robots.prototype("none"), TIME, motor_angle=3.0 * TIME, load=LOAD, cells=1)


def test_the_load_is_the_rolling_joints_own() -> None:
    body = RollingLoad(load_mass=0.7)
    k = Load(body).coefficients()
    angle = np.linspace(-0.6, 0.6, 25)
    zero = np.zeros_like(angle)
    np.testing.assert_allclose(weight(k, angle), body.torque(angle, zero, zero), rtol=1e-12)
    inertia = body.torque(angle, zero, zero + 1.0) - body.torque(angle, zero, zero)
    np.testing.assert_allclose(k[0] + k[1] * np.cos(angle), inertia, rtol=1e-12)
    turning = body.torque(angle, zero + 1.0, zero) - body.torque(angle, zero, zero)
    np.testing.assert_allclose(-0.5 * k[1] * np.sin(angle), turning, atol=1e-12)
