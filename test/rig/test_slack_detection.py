"""Slack that a motion brings about must be seen from the encoders alone, and in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.commands.shared import load_model
from cdrj_ros.estimation.conditioning import Readings, condition
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.model.joint import RollingLoad
from cdrj_ros.model.status import SLACK
from cdrj_ros.rig.motion import sine
from cdrj_ros.rig.sensors import JOINT_ENCODER, MOTOR_ENCODER, Encoder, read_encoder, reading_times
from cdrj_ros.rig.truth import simulate

ROBOT = str(Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml")
ALLOWED_S = 0.02


def readings(encoder: Encoder, time: np.ndarray, angle: np.ndarray) -> Readings:
    """What the rig's encoder says, stamped from one second on."""
    when = reading_times(0.0, time[-1], encoder.rate, encoder.phase_s)
    stamps = 1_000_000_000 + np.round(when * 1e9).astype(np.int64)
    return Readings(stamps, stamps, read_encoder(encoder, when, time, angle))


@pytest.mark.parametrize(
    ("frequency", "duration", "onsets"), [(0.1, 16.0, 8), (0.3, 8.0, 16), (0.5, 6.0, 16)]
)
def test_slack_is_declared_within_twenty_milliseconds(
    frequency: float, duration: float, onsets: int
) -> None:
    model = load_model(ROBOT, "23.52,6.66")
    robot = model.robot
    time = np.arange(0.0, duration, 1e-3)
    course = sine(np.radians(38.0), frequency, 1.0)(time)
    heavy = RollingLoad(load_mass=0.9)  # the lower cable cannot keep its tension
    torque = heavy.torque(course.angle, course.speed, course.acceleration)
    truth = simulate(robot, time, course.angle, torque, 20.0, cells=2, allow_slack=True)
    heard = condition(
        robot,
        {"winch": readings(MOTOR_ENCODER, time, truth.motor_angle[:, 0])},
        {"elbow": readings(JOINT_ENCODER, time, truth.joint_angle[:, 0])},
    ).segments[0]
    _, estimates = run(model, initial_state(model), heard)
    flags = estimates.values[:, model.layout.status].astype(int) & SLACK != 0
    seen_at = heard.stamp_ns * 1e-9 - 1.0

    seen = 0
    for e in range(8, 16):
        tension = truth.tension[:, e]
        slack = tension <= robot.cables[1].slack_tension
        for k in np.flatnonzero(slack[1:] & ~slack[:-1]) + 1:
            if not np.all(tension[max(k - 200, 0) : k] > robot.cables[1].slack_tension):
                continue  # it has only just been slack
            flagged = seen_at[flags[:, e] & (seen_at > time[k] - 0.15)]
            assert abs(flagged[0] - time[k]) <= ALLOWED_S, (e, time[k])
            seen += 1
    assert seen >= onsets
    assert not flags[:, :8].any()  # the upper cable stays taut, and nobody says otherwise
