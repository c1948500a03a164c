"""Slack that a motion brings about must be seen from the encoders alone, and in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdrj_ros.commands.shared import load_model
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.model.mechanism import SLACK
from cdrj_ros.model.plan import shape_at
from cdrj_ros.rig.motion import sine
from cdrj_ros.rig.truth import simulate

ROBOT = str(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")
ALLOWED_S = 0.02


def test_slack_is_declared_within_twenty_milliseconds_and_a_count_of_the_encoder() -> None:
    model = load_model(ROBOT, "23.52,6.66")
    robot = model.robot
    time = np.arange(0.0, 16.0, 1e-3)
    course = sine(np.radians(38.0), 0.1, 1.0)(time)
    heavy = RollingLoad(load_mass=0.9)  # the lower cable cannot keep its tension
    torque = heavy.torque(course.angle, course.speed, course.acceleration)
    truth = simulate(robot, time, course.angle, torque, cells=2, allow_slack=True)
    counted = [
        np.round(angle / axis.sensor.resolution) * axis.sensor.resolution
        for axis, angle in zip(robot.axes, (truth.motor_angle, truth.joint_angle), strict=True)
    ]
    samples = Samples(1_000_000_000 + np.round(time * 1e9).astype(np.int64), *counted)
    _, estimates = run(model, initial_state(model), samples)
    flags = estimates.values[:, model.layout.status].astype(int) & SLACK != 0

    # one count of the joint's encoder is worth so many newtons
    shape = shape_at(model, np.zeros(1))
    seen = 0
    for c, cable in enumerate(robot.cables):
        part = slice(8 * c, 8 * c + 8)
        stiffness = cable.axial_stiffness / shape.length[part].sum()
        lever = abs(shape.length_by_joint[part].sum())
        count = stiffness * lever * robot.joints[0].sensor.resolution
        for e in range(part.start, part.stop):
            tension = truth.tension[:, e]
            slack = tension <= cable.slack_tension
            for k in np.flatnonzero(slack[1:] & ~slack[:-1]) + 1:
                if not np.all(tension[k - 200 : k] > cable.slack_tension):
                    continue  # it has only just been slack
                rate = (tension[k - 100] - tension[k]) / 0.1
                late = int(np.argmax(flags[k:, e])) * 1e-3
                assert flags[k:, e].any()
                assert late <= ALLOWED_S + count / rate
                seen += 1
    assert seen >= 8
    assert not flags[:, :8].any()  # the upper cable stays taut, and nobody says otherwise
