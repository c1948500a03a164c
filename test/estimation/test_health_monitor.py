"""The health monitor: what has changed on the robot, by how much, from which sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.estimation.health_monitor import HealthMonitor
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Pulley, Robot

CELLS = ("upper/8", "lower/8")
EFFORT_NOISE, CELL_NOISE = 0.01, 0.1
Sensors = tuple[str, ...]
BOTH: Sensors = ("effort", "cells")


@pytest.fixture(scope="module")
def motion(model: Model, recorded: Callable[[Model, int], Samples]) -> Samples:
    """Recorded angles of five cycles, at 25 Hz."""
    whole = recorded(model, 60)
    kept = 5 * whole.stamp_ns.size // 6
    return Samples(*(column[:kept] for column in vars(whole).values()))


def with_preload(share: float, *names: str) -> Callable[[Robot], Robot]:
    return lambda robot: replace(
        robot,
        cables=tuple(
            replace(c, preload=share * c.preload) if c.name in names else c for c in robot.cables
        ),
    )


def with_pulleys(changed: Callable[[Pulley, float], Pulley]) -> Callable[[Robot], Robot]:
    return lambda robot: replace(
        robot,
        cables=tuple(
            replace(
                c,
                nodes=tuple(changed(n, c.preload) if isinstance(n, Pulley) else n for n in c.nodes),
            )
            for c in robot.cables
        ),
    )


def dragging(pulley: Pulley, preload: float) -> Pulley:
    return replace(pulley, bearing_torque=0.04 * preload * pulley.radius)


def same(robot: Robot) -> Robot:
    return robot


def true_readings(model: Model, robot: Callable[[Robot], Robot], motion: Samples) -> np.ndarray:
    """Motor effort [N m] and both cells [N] of a changed robot, shape (n, 3)."""
    real = prepare(robot(model.robot), check_range=False)
    values = run(real, initial_state(real), motion)[1].values
    names = real.layout.elements
    columns = [real.layout.motor_effort.start] + [
        real.layout.tension.start + names.index(one) for one in CELLS
    ]
    return values[:, columns]


def watch(
    model: Model,
    motion: Samples,
    readings: np.ndarray,
    sensors: Sensors = BOTH,
    seed: int = 0,
    monitor: HealthMonitor | None = None,
) -> HealthMonitor:
    """Feed a monitor with noisy readings."""
    monitor = monitor or HealthMonitor(model, model.robot.uncertainty)
    generator = np.random.default_rng(seed)
    for k, stamp in enumerate(motion.stamp_ns.tolist()):
        effort = readings[k, :1] + generator.normal(0.0, EFFORT_NOISE, 1)
        cells = readings[k, 1:] + generator.normal(0.0, CELL_NOISE, 2)
        if "effort" in sensors:
            monitor.read_efforts(stamp, ["winch"], effort)
        if "cells" in sensors:
            monitor.read_tensions(stamp, CELLS, cells, [CELL_NOISE] * 2)
        monitor.follow(motion.at(k))
    return monitor


def found(monitor: HealthMonitor) -> dict[str, float]:
    """Amounts of the changes in the verdict, by name."""
    standing = monitor.standing
    changes = standing.found if standing is not None else ()
    return {one.change.what: one.amount for one in changes if one.matters}


@pytest.mark.parametrize("sensors", [("effort",), ("cells",), BOTH])
def test_a_robot_that_is_as_its_file_says_raises_no_alarm(
    model: Model, motion: Samples, sensors: Sensors
) -> None:
    monitor = watch(model, motion, true_readings(model, same, motion), sensors)
    assert monitor.cycles >= 2
    assert monitor.report().level == "ok"
    assert monitor.report().message == "agrees with the robot file"


@pytest.mark.parametrize(
    ("changed", "what", "amount", "within"),
    [
        (with_preload(0.9, "upper"), "preload of upper", -3.685, 0.4),
        (with_preload(0.85, "lower"), "preload of lower", -3.94, 0.4),
        (with_preload(0.8, "upper", "lower"), "preload of all cables", -20.0, 2.0),
        (with_pulleys(dragging), "friction of the pulleys (drag)", 4.0, 0.8),
    ],
)
def test_a_change_is_named_and_quantified(
    model: Model,
    motion: Samples,
    changed: Callable[[Robot], Robot],
    what: str,
    amount: float,
    within: float,
) -> None:
    monitor = watch(model, motion, true_readings(model, changed, motion))
    assert found(monitor) == {what: pytest.approx(amount, abs=within)}
    report = monitor.report()
    assert report.level == "warn"
    assert report.message.startswith(what)


def test_a_wrong_zero_is_found_by_the_effort_alone(model: Model, motion: Samples) -> None:
    readings = true_readings(model, same, motion)
    off = np.radians(1.0)
    wrong = Samples(motion.stamp_ns, motion.motor_angle, motion.joint_angle + off)
    monitor = watch(model, wrong, readings, ("effort",))
    assert found(monitor) == {"zero of joint elbow": pytest.approx(1.0, abs=0.1)}
    assert "too much" in monitor.report().message
    error = (readings - true_readings(model, same, wrong))[:, 0]
    said = monitor.report().values["deviation of winch [N m]"].replace(",", "").split()
    before, after = float(said[0]), float(said[4])
    assert before == pytest.approx(float(np.sqrt(np.mean(error**2))), rel=0.1)
    assert after < EFFORT_NOISE


def test_friction_of_the_motor_is_told_from_that_of_the_pulleys_by_load_cells(
    model: Model, motion: Samples
) -> None:
    readings = true_readings(model, same, motion)
    speed = np.gradient(motion.motor_angle[:, 0])
    readings[:, 0] -= 0.06 * np.sign(np.where(np.abs(speed) > 1e-6, speed, 0.0))
    monitor = watch(model, motion, readings)
    assert found(monitor) == {"friction of motor winch": pytest.approx(0.06, abs=0.01)}
    alone = watch(model, motion, readings, ("effort",)).standing
    assert alone is not None
    assert any("pulleys" in other for other in alone.found[0].others)


def test_a_broken_cable_is_found_before_a_cycle_ends(model: Model, motion: Samples) -> None:
    whole = true_readings(model, same, motion)

    def broken(robot: Robot) -> Robot:
        upper, lower = robot.cables
        return replace(robot, cables=(replace(upper, preload=0.0, axial_stiffness=1e-5), lower))

    gone = true_readings(model, broken, motion)
    cycle = motion.stamp_ns.size // 5
    at = 2 * cycle
    readings = np.where((np.arange(len(whole)) >= at)[:, None], gone, whole)
    begin = Samples(*(column[: at + cycle // 4] for column in vars(motion).values()))
    monitor = watch(model, begin, readings)
    report = monitor.report()
    assert report.level == "error"
    assert "cable upper carries nothing" in report.message


def test_a_sudden_loss_of_preload_is_told_from_an_old_one(model: Model, motion: Samples) -> None:
    whole = true_readings(model, same, motion)
    less = true_readings(model, with_preload(0.85, "upper"), motion)
    at = motion.stamp_ns.size // 2 - 20
    readings = np.where((np.arange(len(whole)) >= at)[:, None], less, whole)
    assert "at once" in watch(model, motion, readings).report().message
    assert "at once" not in watch(model, motion, less).report().message


def test_angles_alone_are_said_to_show_nothing(model: Model, motion: Samples) -> None:
    monitor = HealthMonitor(model)
    for k in range(200):
        monitor.follow(motion.at(k))
    assert "angles alone" in monitor.report().message
    assert monitor.report().level == "ok"


def test_readings_that_are_not_numbers_or_of_unknown_sensors_are_ignored(
    model: Model, motion: Samples
) -> None:
    monitor = HealthMonitor(model)
    monitor.read_efforts(1, ["winch", "nobody"], [float("nan"), 1.0])
    monitor.read_tensions(1, ["nobody/1", "upper/8"], [1.0, float("inf")])
    assert monitor.report().values["sensors"] == "none"
    readings = true_readings(model, same, motion)
    readings[::7] = np.nan
    assert watch(model, motion, readings, monitor=monitor).report().level == "ok"


def test_a_change_within_the_tolerance_of_the_file_is_no_alarm(
    model: Model, motion: Samples
) -> None:
    document = {k: v for k, v in model.robot.document.items() if k != "uncertainty"}
    from cdrj_ros.robot.reader import build_robot

    fresh = prepare(build_robot(document, "fresh"))  # preloads are known to 10 %
    readings = true_readings(model, with_preload(0.9, "upper"), motion)
    monitor = watch(fresh, motion, readings)
    assert monitor.report().level == "ok"
    assert "preload of upper -3." in monitor.report().values["seen in the last cycle"]


def test_the_verdict_ends_once_the_robot_agrees_with_its_file_again(
    model: Model, motion: Samples
) -> None:
    less = true_readings(model, with_preload(0.85, "upper"), motion)
    monitor = watch(model, motion, less)
    assert monitor.report().level == "warn"
    step = int(np.median(np.diff(motion.stamp_ns)))
    after = Samples(
        motion.stamp_ns + step * motion.stamp_ns.size,
        motion.motor_angle[::-1],
        motion.joint_angle[::-1],
    )
    watch(model, after, true_readings(model, same, after), monitor=monitor)
    assert monitor.report().level == "ok"


def test_one_cycle_suffices_for_what_no_change_explains_unless_few_readings_cause_it(
    model: Model, motion: Samples
) -> None:
    two = 2 * motion.stamp_ns.size // 5 + motion.stamp_ns.size // 20  # the first is not judged
    short = Samples(*(column[:two] for column in vars(motion).values()))
    wrong = true_readings(model, same, short)
    wrong[:, 0] = 3.0 * np.cos(7.0 * short.joint_angle[:, 0])
    assert watch(model, short, wrong, ("effort",)).standing is not None
    glitch = true_readings(model, same, motion)
    glitch[6 * two // 10 :: two // 2, 0] = 100.0  # once or twice per cycle
    monitor = watch(model, motion, glitch, ("effort",))
    assert monitor.cycles >= 3
    lone = watch(model, short, glitch[:two], ("effort",))
    assert lone.cycles == 1
    off = lone.report().values["deviation of winch [N m]"]
    assert float(off.split()[0]) > 1.0, "the cycle holds the wrong reading"
    assert lone.standing is None


def test_the_clock_may_be_set_back_and_readings_may_pause(model: Model, motion: Samples) -> None:
    readings = true_readings(model, same, motion)
    monitor = watch(model, motion, readings)
    before = monitor.cycles
    watch(model, motion, readings, monitor=monitor)
    late = Samples(motion.stamp_ns + 10**12, motion.motor_angle, motion.joint_angle)
    watch(model, late, readings, monitor=monitor)
    assert monitor.cycles >= before + 4
    assert monitor.report().level == "ok"


def test_an_effort_that_is_not_measured_is_not_compared(model: Model, motion: Samples) -> None:
    monitor = HealthMonitor(model)
    for k, stamp in enumerate(motion.stamp_ns.tolist()):
        monitor.read_efforts(stamp, ["winch"], [0.0])
        monitor.follow(motion.at(k))
    assert monitor.report().level == "ok"
