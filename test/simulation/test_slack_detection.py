"""Slack caused by a motion must be detected in time from the encoders alone."""

from dataclasses import dataclass

import numpy as np
import pytest
from support.places import ROBOT

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.packing import SLACK
from cdrj_ros.model.prepared import load_model
from cdrj_ros.robot.description import Sensor
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, random, sine
from cdrj_ros.simulation.sensors import JOINT_ENCODER, MOTOR_ENCODER, ReadingTimes, counted
from cdrj_ros.simulation.truth import simulate

AMPLITUDE = float(np.radians(38.0))
LOW = "23.52,6.66"
"""The source's lower preloads [N]."""
ALLOWED_S = 0.02
SLACK_N = 0.1
COUNT_N = 0.31
"""Tension that corresponds to one count of the joint encoder [N]."""
HEAVY = ((0.1, 16.0, 8), (0.3, 8.0, 16), (0.5, 6.0, 16))
"""Sines in which 0.9 kg make the lower cable slack: frequency [Hz], duration [s], and the smallest
number of changes of slack."""


@dataclass(frozen=True)
class Watched:
    """A motion of the rig and its estimates, by sample and element."""

    step_s: float
    """Time step of the truth [s]."""
    tension: np.ndarray
    """True [N], every ``step_s``."""
    seen_at: np.ndarray
    """Stamps of the estimates, on the truth's clock [s]."""
    estimate: np.ndarray
    """[N]."""
    flags: np.ndarray

    @property
    def slack(self):
        return self.tension <= SLACK_N

    def then(self, truth):
        """Rows of the truth at the estimates' stamps."""
        return truth[np.rint(self.seen_at / self.step_s).astype(int)]

    def around(self, truth):
        """Whether ``truth`` holds for an element within ``ALLOWED_S`` of the estimates' stamps."""
        window = np.ones(2 * round(ALLOWED_S / self.step_s) + 1)
        near = [np.convolve(column, window, "same") > 0.5 for column in truth.T]
        return self.then(np.stack(near, axis=1))


def readings(encoder, time, angle):
    """Readings of the rig's encoder, with stamps that start at one second."""
    when = ReadingTimes(encoder, [0]).until(time[-1]).times
    stamps = 1_000_000_000 + np.round(when * 1e9).astype(np.int64)
    return Series(stamps, stamps, counted(encoder, np.interp(when, time, angle), 0.0, Sensor()))


def watch(preload, load_kg, motion, duration, step_s=1e-3, motor_speed=60.0):
    """Simulate the rig and estimate from its encoders alone."""
    model = load_model(ROBOT, preload)
    robot = model.robot
    assert {cable.slack_tension for cable in robot.cables} == {SLACK_N}
    time = step_s * np.arange(round(duration / step_s))
    angle = motion(time - 1.0)
    load = make_load("rolling", load_kg)
    torque = load.torque(*differences(time, angle))
    truth = simulate(robot, time, angle, torque, motor_speed, 2, allow_slack=True)
    heard = condition(
        robot,
        {"winch": readings(MOTOR_ENCODER, time, truth.motor_angle[:, 0])},
        {"elbow": readings(JOINT_ENCODER, time, truth.joint_angle[:, 0])},
    ).segments[0]
    _, estimates = run(model, initial_state(model), heard)
    layout = model.layout
    return Watched(
        step_s,
        truth.tension,
        heard.stamp_ns * 1e-9 - 1.0,
        estimates.values[:, layout.tension],
        estimates.values[:, layout.status].astype(int) & SLACK != 0,
    )


@pytest.mark.parametrize(("frequency", "duration", "changes"), HEAVY)
def test_flag_and_truth_differ_only_within_twenty_milliseconds_of_a_change(
    frequency, duration, changes
):
    # 0.9 kg: the lower cable cannot keep its tension
    watched = watch(LOW, 0.9, sine(AMPLITUDE, frequency), duration, 2e-3, motor_speed=20.0)
    slack = watched.slack
    assert np.count_nonzero(slack[1:] & ~slack[:-1]) >= changes
    assert not watched.flags[:, :8].any()  # the upper cable stays taut and is never flagged
    assert not np.any(watched.flags & ~watched.around(watched.slack))
    assert not np.any(~watched.flags & ~watched.around(~watched.slack))


def test_no_alarm_in_a_minute_of_a_motion_that_leaves_every_cable_nearly_slack_but_taut():
    """Truth every 6 ms, encoders at 1000 and 500 Hz; nothing repeats."""
    watched = watch(LOW, 0.6, random(AMPLITUDE, 1.0, 1), 60.0, step_s=6e-3)
    assert COUNT_N < watched.tension.min() < COUNT_N + 1.0
    assert watched.seen_at[-1] > 59.9
    assert not watched.flags.any()
