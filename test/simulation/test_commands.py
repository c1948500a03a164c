"""Commands to the live rig: refusals, their causes, and that refused commands have no effect."""

from __future__ import annotations

from types import SimpleNamespace as Robots
from typing import Any

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.simulation.commands import (
    CAUSES,
    CommandError,
    DriveLimits,
    checked_command,
    checked_trajectory,
)
from cdrj_ros.simulation.drives import Drives, drive_limits
from cdrj_ros.simulation.live import LiveRig, LiveSettings
from cdrj_ros.simulation.load import make_load

NAN, INF = float("nan"), float("inf")
FLEXOR, EXTENSOR = "flexor_motor", "extensor_motor"


@pytest.fixture(scope="module")
def limits(robots: Robots) -> DriveLimits:
    return drive_limits(robots.finger(), 1000.0)


def turn(drives: Drives, steps: int, first: int = 0) -> np.ndarray:
    """Angles of an unloaded finger's motors, shape (steps, motors)."""
    rows = [
        drives.next(k, k / 1000.0, 1e-3, np.zeros(2)) for k in range(first + 1, first + steps + 1)
    ]
    return np.array(rows)


@pytest.mark.parametrize(
    ("mode", "names", "values", "cause"),
    [
        ("position", None, [0.1], "wrong length"),
        ("position", None, [], "wrong length"),
        ("velocity", None, [0.1, 0.2, 0.3], "wrong length"),
        ("velocity", [FLEXOR], [0.1, 0.2], "wrong length"),
        ("effort", [], [], "wrong length"),
        ("effort", ["thumb"], [0.1], "unknown name"),
        ("effort", ["\x1b[2J" * 99], [0.1], "unknown name"),
        ("effort", [FLEXOR, FLEXOR], [0.1, 0.2], "malformed"),
        ("position", [FLEXOR], [NAN], "not finite"),
        ("velocity", [FLEXOR], [INF], "not finite"),
        ("effort", [FLEXOR], [-INF], "not finite"),
        ("position", [FLEXOR], [1e4], "out of range"),
        ("velocity", [FLEXOR], [1e300], "out of range"),
        ("effort", [FLEXOR], [-1e6], "out of range"),
    ],
)
def test_an_invalid_command_is_refused_with_its_cause(
    limits: DriveLimits, mode: Any, names: Any, values: Any, cause: str
) -> None:
    with pytest.raises(CommandError) as caught:
        checked_command(limits, mode, names, values)
    assert caught.value.cause == cause
    assert cause in CAUSES
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("times", "positions", "velocities", "cause"),
    [
        ([0.1, 0.1], [[0.0], [0.1]], [[], []], "out of range"),
        ([-0.1], [[0.0]], [[]], "out of range"),
        ([NAN], [[0.0]], [[]], "out of range"),
        ([1e9], [[0.0]], [[]], "out of range"),
        ([0.1], [[]], [[]], "wrong length"),
        ([0.1], [[NAN]], [[]], "not finite"),
        ([0.1], [[1e9]], [[]], "out of range"),
        ([0.1, 0.2], [[0.0], [0.1]], [[0.1], []], "wrong length"),
        ([0.1], [[0.0]], [[NAN]], "not finite"),
    ],
)
def test_an_invalid_trajectory_is_refused_with_its_cause(
    limits: DriveLimits, times: Any, positions: Any, velocities: Any, cause: str
) -> None:
    with pytest.raises(CommandError) as caught:
        checked_trajectory(limits, [FLEXOR], times, positions, velocities)
    assert caught.value.cause == cause


def test_a_rotor_too_light_for_the_step_is_refused(robots: Robots) -> None:
    with pytest.raises(UsageError, match="rotor_inertia must be at least"):
        drive_limits(robots.finger(), 1000.0, rotor_inertia=1e-9)


def test_a_trajectory_runs_straight_between_its_points_and_then_holds(limits: DriveLimits) -> None:
    drives = Drives(limits)
    drives.command(checked_trajectory(limits, [EXTENSOR], [0.1, 0.3], [[0.2], [0.1]], [[], []]), 0)
    angles = turn(drives, 500)
    wanted = np.interp(np.arange(1, 501) / 1000.0, [0.0, 0.1, 0.3], [0.0, 0.2, 0.1])
    np.testing.assert_allclose(angles[:, 1], wanted, atol=1e-12)
    assert not angles[:, 0].any()


def test_a_trajectory_with_speeds_has_them_at_its_points(limits: DriveLimits) -> None:
    drives = Drives(limits)
    points = checked_trajectory(limits, [FLEXOR], [0.1, 0.2], [[0.1], [0.2]], [[1.5], [0.0]])
    drives.command(points, 0.0)
    angle = np.concatenate([[0.0], turn(drives, 300)[:, 0]])
    assert angle[[100, 200, 300]] == pytest.approx([0.1, 0.2, 0.2], abs=1e-12)
    speed = np.gradient(angle, 1e-3)
    assert speed[100] == pytest.approx(1.5, abs=0.05)
    assert speed[[0, 200]] == pytest.approx([0.0, 0.0], abs=0.05)


def test_another_command_or_an_empty_trajectory_ends_a_trajectory(limits: DriveLimits) -> None:
    way = checked_trajectory(limits, [FLEXOR, EXTENSOR], [1.0], [[1.0, -1.0]], [[]])
    stop = checked_trajectory(limits, [FLEXOR, EXTENSOR], [], [], [])
    for ending in (stop, checked_command(limits, "position", [FLEXOR], [0.0])):
        drives = Drives(limits)
        drives.command(way, 0.0)
        turn(drives, 100)
        drives.command(ending, 0.1)
        angles = turn(drives, 200, 100)
        np.testing.assert_array_equal(angles[:, 1], drives.angle[1])
        assert drives.angle[1] == pytest.approx(-0.1)
        assert drives.angle[0] == pytest.approx(0.0 if ending is not stop else 0.1)


def test_the_first_command_ends_the_program(limits: DriveLimits) -> None:
    drives = Drives(limits, lambda step: np.full(2, 1e-3 * step))
    np.testing.assert_allclose(turn(drives, 50)[-1], 0.05)
    drives.command(checked_command(limits, "position", [FLEXOR], [0.0]), 0.05)
    assert turn(drives, 50, 50)[-1] == pytest.approx([0.0, 0.05])
    drives.reset()
    np.testing.assert_allclose(turn(drives, 50)[-1], 0.05)


def test_every_output_stays_finite_whatever_is_commanded(robots: Robots) -> None:
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
                command = checked_command(limits, mode, None, random.choice(hostile, 2).tolist())
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
