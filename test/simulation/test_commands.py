"""Commands to the live rig: refusals, their causes, and that refused commands have no effect."""

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.simulation.drives import CAUSES, CommandError, Drives, checked_command, drive_limits
from cdrj_ros.simulation.live import LiveRig, LiveSettings
from cdrj_ros.simulation.load import make_load

NAN, INF = float("nan"), float("inf")


@pytest.fixture(scope="module")
def limits(robots):
    return drive_limits(robots.finger(), 1000.0)


def turn(drives, steps, first=0):
    """Angles of an unloaded finger's motors, shape (steps, motors)."""
    rows = [
        drives.next(k, k / 1000.0, 1e-3, np.zeros(2)) for k in range(first + 1, first + steps + 1)
    ]
    return np.array(rows)


@pytest.mark.parametrize(
    ("mode", "values", "cause"),
    [
        ("position", [0.1], "wrong length"),
        ("position", [], "wrong length"),
        ("velocity", [0.1, 0.2, 0.3], "wrong length"),
        ("position", [NAN, 0.0], "not finite"),
        ("velocity", [0.0, INF], "not finite"),
        ("effort", [-INF, 0.0], "not finite"),
        ("position", [0.0, 1e4], "out of range"),
        ("velocity", [1e300, 0.0], "out of range"),
        ("effort", [0.0, -1e6], "out of range"),
    ],
)
def test_an_invalid_command_is_refused_with_its_cause(limits, mode, values, cause):
    with pytest.raises(CommandError) as caught:
        checked_command(limits, mode, values)
    assert caught.value.cause == cause
    assert cause in CAUSES


def test_a_rotor_too_light_for_the_step_is_refused(robots):
    with pytest.raises(UsageError, match="rotor_inertia must be at least"):
        drive_limits(robots.finger(), 1000.0, rotor_inertia=1e-9)


def test_the_first_command_ends_the_program(limits):
    drives = Drives(limits, lambda step: np.full(2, 1e-3 * step))
    np.testing.assert_allclose(turn(drives, 50)[-1], 0.05)
    drives.command(checked_command(limits, "position", [0.0, 0.05]), 0.05)
    assert turn(drives, 50, 50)[-1] == pytest.approx([0.0, 0.05])
    drives.reset()
    np.testing.assert_allclose(turn(drives, 50)[-1], 0.05)


def test_every_output_stays_finite_whatever_is_commanded(robots):
    robot = robots.finger()
    limits = drive_limits(robot, 1000.0, command_timeout=0.02)
    load = make_load("pendulum", 0.05, 0.01)
    rig, drives = LiveRig(robot, LiveSettings(load, cells=1)), Drives(limits)
    random = np.random.default_rng(7)
    hostile = [NAN, INF, -INF, 1e308, -1e9, 900.0, -900.0, 9.9, -9.9, 0.3, -0.3, 0.0]
    refused = 0
    for k in range(1, 1_500):
        if k % 5 == 0:
            mode = random.choice(["position", "velocity", "effort"])
            try:
                command = checked_command(limits, mode, random.choice(hostile, 2).tolist())
                drives.command(command, rig.time_s)
            except CommandError:
                refused += 1
        if not rig.step(drives.next(k, k / 1000.0, 1e-3, rig.motor_effort)):
            drives.stopped(rig.motor_angle)
        for values in (rig.tension, rig.joint_angle, rig.motor_angle, rig.motor_effort):
            assert np.isfinite(values).all()
        assert (rig.tension >= 0.0).all()
        assert rig.lower <= rig.joint_angle[0] <= rig.upper
    assert 100 < refused < 299
