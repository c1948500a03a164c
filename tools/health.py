#!/usr/bin/env python3
"""Let the health monitor watch the simulated rig while it changes, and while it does not.

python tools/health.py                 print the table of changes and when they are found
python tools/health.py --hours 4       count false alarms over hours of motion, with several seeds

The truth has four contact cells per pulley.  The motor's effort has a noise of 10 mN m, the load
cells at elements 8 of 0.1 N; both are read at 100 Hz.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.robot.description import Pulley, Robot
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.faults import Slip
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, random, sine
from cdrj_ros.simulation.truth import simulate

ROOT = Path(__file__).resolve().parents[1]

Vector = NDArray[np.float64]

ROBOT: Final = str(ROOT / "config" / "robots" / "prototype.yaml")
RATE: Final = 100.0
FREQUENCY: Final = 0.25
CELLS: Final = ("upper/8", "lower/8")
EFFORT_NOISE: Final = 0.01
CELL_NOISE: Final = 0.1
SENSORS: Final = (("effort",), ("cells",), ("effort", "cells"))


@dataclass(frozen=True)
class Case:
    """One difference between the rig and its robot file."""

    what: str
    robot: Callable[[Robot], Robot] = lambda robot: robot
    zero: float = 0.0
    """Reading of the joint less its angle [rad]."""
    motor_friction: float = 0.0
    """Friction of the motor that is not in the file [N m]."""
    faults: tuple[Slip, ...] = ()
    broken: bool = False
    effort_sign: float = 1.0


def less_preload(share: float, names: Sequence[str]) -> Callable[[Robot], Robot]:
    """A robot whose cables have lost a share of their preload."""
    return lambda robot: replace(
        robot,
        cables=tuple(
            replace(c, preload=c.preload * (1.0 - share)) if c.name in names else c
            for c in robot.cables
        ),
    )


def rougher(factor: float, drag: float) -> Callable[[Robot], Robot]:
    """A robot with other friction, and with drag as a fraction of the preload."""

    def changed(robot: Robot) -> Robot:
        def pulley(node: Any, preload: float) -> Any:
            if not isinstance(node, Pulley):
                return node
            own = node.friction
            return replace(
                node,
                friction=replace(own, mu_c=own.mu_c * factor, mu_s=own.mu_s * factor),
                bearing_torque=node.bearing_torque + drag * preload * node.radius,
            )

        return replace(
            robot,
            cables=tuple(
                replace(c, nodes=tuple(pulley(n, c.preload) for n in c.nodes)) for c in robot.cables
            ),
        )

    return changed


CASES: Final = (
    Case("nothing"),
    Case("preload of upper −10 %", less_preload(0.1, ["upper"])),
    Case("preload of lower −10 %", less_preload(0.1, ["lower"])),
    Case("preload of both −10 %", less_preload(0.1, ["upper", "lower"])),
    Case("preload of both −30 %", less_preload(0.3, ["upper", "lower"])),
    Case("joint zero off by 1°", zero=np.radians(1.0)),
    Case("friction +50 %", rougher(1.5, 0.0)),
    Case("drag of 3 % of preload on every pulley", rougher(1.0, 0.03)),
    Case("motor friction 40 mN·m", motor_friction=0.04),
    Case("upper drum slips by 0.5 mm at 12 s", faults=(Slip(12.0, 0.5e-3 / 0.015, "upper"),)),
    Case("upper cable broken", broken=True),
    Case("effort with the wrong sign", effort_sign=-1.0),
)


def motion_of(robot: Robot, case: Case, seconds: float, seed: int | None) -> Truth:
    """The rig in motion: a sine, or with a seed a random motion."""
    time = np.arange(0.0, seconds, 1.0 / RATE)
    move = (
        sine(np.radians(35.0), FREQUENCY, 1.0)
        if seed is None
        else random(np.radians(38.0), 0.5, seed, 1.0)
    )
    angle = move(time)
    load = make_load("rolling")
    torque = load.torque(*differences(time, angle))
    return simulate(
        case.robot(robot), time, angle, torque, 20.0, cells=4, faults=case.faults,
        allow_slack=True,
    )  # fmt: skip


@dataclass
class Watched:
    """An estimator with one set of sensors, and what it has said."""

    sensors: tuple[str, ...]
    live: LiveEstimator
    said: list[tuple[float, str]]
    """Times [s] of changes of its verdict; an empty verdict where it was taken back."""

    def note(self, time: float) -> None:
        """Note the present verdict."""
        assert self.live.corrections is not None
        text = self.live.corrections.report()
        if text.level != "ok" and (not self.said or self.said[-1][1] != text.message):
            self.said.append((time, text.message))
        elif text.level == "ok" and self.said and self.said[-1][1]:
            self.said.append((time, ""))


def watch(model: Model, case: Case, truth: Truth, seed: int) -> list[Watched]:
    """Run one estimator per set of sensors."""
    generator = np.random.default_rng(seed)
    watched = [Watched(sensors, LiveEstimator(model, Options()), []) for sensors in SENSORS]
    counts = [axis.sensor.resolution for axis in model.robot.axes]
    columns = [model.layout.elements.index(name) for name in CELLS]
    for k, time in enumerate(truth.time):
        stamp = 1_000_000_000 + round(time * 1e9)
        motor = np.round(truth.motor_angle[k] / counts[0]) * counts[0]
        joint = np.round((truth.joint_angle[k] + case.zero) / counts[1]) * counts[1]
        effort = case.effort_sign * truth.motor_effort[k] + generator.normal(0.0, EFFORT_NOISE, 1)
        if case.motor_friction and k:
            turned = truth.motor_angle[k] - truth.motor_angle[k - 1]
            effort = effort - case.motor_friction * np.tanh(turned / 1e-5)
        cells = truth.tension[k, columns] + generator.normal(0.0, CELL_NOISE, len(CELLS))
        sample = Sample(stamp, motor, joint)
        for one in watched:
            if "effort" in one.sensors:
                one.live.feed_efforts(stamp, ["winch"], effort)
            if "cells" in one.sensors:
                one.live.feed_tensions(stamp, CELLS, cells, [CELL_NOISE] * len(CELLS))
            one.live.take(sample)
            if k % round(RATE) == 0 and k:
                one.note(float(time))
    return watched


def broken_truth(model: Model, truth: Truth) -> Truth:
    """The same motion with nothing on the upper cable."""
    lower = model.layout.elements.index("lower/1")
    tension = truth.tension.copy()
    tension[:, :lower] = 0.0
    effort = truth.tension[:, lower : lower + 1] * 0.015
    return replace(truth, tension=tension, motor_effort=effort)


def main() -> None:
    """Print the table, or the false alarms."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=0.0)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--only", default="", help="cases whose name contains this")
    arguments = parser.parse_args()
    model = load_model(ROBOT)
    if arguments.hours:
        hours(model, arguments.hours, arguments.seeds)
        return
    for case in CASES:
        if arguments.only not in case.what:
            continue
        truth = motion_of(model.robot, case, 50.0, None)
        if case.broken:
            truth = broken_truth(model, truth)
        for one in watch(model, case, truth, 0):
            begin = max((fault.begin for fault in case.faults), default=1.0)
            first = f"{(one.said[0][0] - begin) * FREQUENCY:.1f} cycles" if one.said else "-"
            print(f"| {case.what} | {' and '.join(one.sensors)} | {first} | "
                  f"{one.live.corrections.report().message} |", flush=True)  # fmt: skip


def hours(model: Model, total: float, seeds: int) -> None:
    """Count the false alarms."""
    alarms = 0
    for seed in range(seeds):
        truth = motion_of(model.robot, CASES[0], 3600.0 * total / seeds, seed)
        for one in watch(model, CASES[0], truth, seed):
            alarms += sum(bool(text) for _, text in one.said)
            print(f"seed {seed}, {' and '.join(one.sensors)}: {one.said}", flush=True)
    print(f"{alarms} alarms in {total:g} h of motion with each set of sensors")


if __name__ == "__main__":
    main()
