"""A drum that several motors turn equals the same drum on a shaft of its own, and work is kept."""

import numpy as np
import pytest
from support.refusal import refusal

from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.truth import simulate

SHARES = np.array([[0.5, 0.25], [0.5, -0.25]])
"""Turns of the two shafts of a differential per turn of its two motors."""

WRIST = """
name: wrist
motors: [{name: left, reference_angle: 0.3}, {name: right, reference_angle: -0.2}]
joints: [{name: pitch, range: [-1, 1]}]
frames: [{name: hand, motion: revolute, joint: pitch, origin: [0.2, 0]}]
friction: {mu_c: 0.15, rho: 0.5}
cables:
  - name: upper
    axial_stiffness: 3000
    preload: 20
    nodes:
      - {type: winch, motor: %s, winding: 1, radius: 0.01, position: [0, 0.02], turn: cw}
      - {type: pulley, radius: 0.008, position: [0.1, 0.03], turn: cw}
      - {type: anchor, frame: hand, radius: 0.02, position: [0, 0], turn: cw}
  - name: lower
    axial_stiffness: 3000
    preload: 20
    nodes:
      - {type: winch, motor: %s, winding: -1, radius: 0.01, position: [0, -0.02], turn: ccw}
      - {type: pulley, radius: 0.008, position: [0.1, -0.03], turn: ccw}
      - {type: anchor, frame: hand, radius: 0.02, position: [0, 0], turn: ccw}
"""
MAPPED = WRIST % ("{left: 0.5, right: 0.25}", "{left: 0.5, right: -0.25}")
OWN = WRIST % ("left", "right")  # the motors of this file are the shafts


def test_tensions_are_those_of_the_shafts_and_efforts_do_the_same_work():
    mapped, own = (prepare(parse_robot(text)) for text in (MAPPED, OWN))
    states = initial_state(mapped), initial_state(own)
    zero = np.array([0.3, -0.2])
    work, before = np.zeros(2), zero
    for k in range(400):
        t = 0.01 * k
        motors = zero + np.array([0.5 * np.sin(2 * t), 0.3 * np.sin(3 * t)])
        shafts = zero + SHARES @ (motors - zero)
        pose = np.array([0.2 * np.sin(2 * t)])
        stamp = 10**9 + k * 10**7
        one, other = (
            step(model, state, Sample(stamp, angle, pose))
            for model, state, angle in zip((mapped, own), states, (motors, shafts), strict=True)
        )
        states = one[0], other[0]
        np.testing.assert_allclose(one[1].tension, other[1].tension, rtol=1e-10)
        np.testing.assert_allclose(
            one[1].motor_effort, SHARES.T @ other[1].motor_effort, rtol=1e-9, atol=1e-12
        )
        change = motors - before
        work += one[1].motor_effort @ change, other[1].motor_effort @ (SHARES @ change)
        before = motors
    assert one[1].tension.std() > 0.1
    assert work[0] == pytest.approx(work[1], rel=1e-9)


def test_the_simulated_rig_follows_the_map():
    time = np.arange(0.0, 1.0, 0.01)
    zero, pose = np.array([0.3, -0.2]), 0.02 * np.sin(2 * time)[:, None]
    motors = zero + np.stack([0.05 * np.sin(2 * time), 0.03 * np.sin(3 * time)], axis=1)
    truths = [
        simulate(parse_robot(text), time, pose, motor_angle=angle, cells=2)
        for text, angle in ((MAPPED, motors), (OWN, zero + (motors - zero) @ SHARES.T))
    ]
    np.testing.assert_allclose(truths[0].tension, truths[1].tension, rtol=1e-9)
    np.testing.assert_allclose(
        truths[0].motor_effort, truths[1].motor_effort @ SHARES, rtol=1e-8, atol=1e-12
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("{left: 0.5, other: 1}", "motor must be one of left, right, got 'other'"),
        ("{left: 0}", "cables[0].nodes[0].motor.left must not be 0: leave the motor out"),
        ("{}", "cables[0].nodes[0].motor"),
    ],
)
def test_a_wrong_map_is_one_clear_line(given, message):
    assert message in refusal(parse_robot, WRIST % (given, "right"))
