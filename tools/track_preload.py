#!/usr/bin/env python3
"""Track preloads by the motor's effort on the simulated rig, with friction of the motor and jumps.

python tools/track_preload.py                  print the tables of docs/uncertainty.md
python tools/track_preload.py --only friction  one of them: friction, jumps, calm

The truth has four contact cells per pulley and moves by a sine of 0.25 Hz.  The effort is read at
100 Hz with a noise of 5 mN m; the motor's friction changes its sign with the motor's speed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cdrj_ros.estimation.estimator import Sample  # noqa: E402
from cdrj_ros.estimation.session import LiveEstimator, Options  # noqa: E402
from cdrj_ros.model.prepared import Model, load_model  # noqa: E402
from cdrj_ros.simulation.assembly import Truth  # noqa: E402
from cdrj_ros.simulation.faults import Fault  # noqa: E402
from cdrj_ros.simulation.load import make_load  # noqa: E402
from cdrj_ros.simulation.motion import differences, sine  # noqa: E402
from cdrj_ros.simulation.truth import simulate  # noqa: E402

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

ROBOT: Final = str(ROOT / "config" / "robots" / "prototype.yaml")
RATE: Final = 100.0
FREQUENCY: Final = 0.25
CYCLE: Final = round(RATE / FREQUENCY)
NOISE: Final = 0.005
CELLS: Final = ("upper/8", "lower/8")
CELL_NOISE: Final = 0.1


@dataclass(frozen=True)
class Tracked:
    """What the estimator said beside the truth."""

    error: Table
    """Estimate less truth of every tension [N], shape (n, elements)."""
    stddev: Table
    """[N], shape (n, elements)."""
    unsure: Table
    """Whether the status is not OK, shape (n, elements)."""
    live: LiveEstimator


@cache
def moved(share: float, cycles: int, fault: Fault | None) -> Truth:
    """The rig in motion, with the upper preload multiplied by ``share``."""
    model = load_model(ROBOT)
    upper, lower = model.robot.cables
    robot = replace(model.robot, cables=(replace(upper, preload=share * upper.preload), lower))
    time = np.arange(0.0, 1.0 + cycles / FREQUENCY, 1.0 / RATE)
    angle = sine(np.radians(35.0), FREQUENCY, 1.0)(time)
    torque = make_load("rolling").torque(*differences(time, angle))
    faults = (fault,) if fault is not None else ()
    return simulate(robot, time, angle, torque, 20.0, cells=4, faults=faults, allow_slack=True)


def track(model: Model, truth: Truth, friction: float, options: Options, seed: int) -> Tracked:
    """Run the estimator with the motor's effort and, if the options say so, both load cells."""
    generator = np.random.default_rng(seed)
    live = LiveEstimator(model, options)
    counts = [axis.sensor.resolution for axis in model.robot.axes]
    columns = [model.layout.elements.index(name) for name in CELLS]
    elements = len(model.layout.elements)
    error, stddev, unsure = np.zeros((3, truth.time.size, elements))
    before = truth.motor_angle[0, 0]
    for k, time in enumerate(truth.time):
        stamp = 1_000_000_000 + round(time * 1e9)
        turned, before = truth.motor_angle[k, 0] - before, truth.motor_angle[k, 0]
        effort = truth.motor_effort[k] - friction * np.tanh(turned / 1e-5)
        live.feed_efforts(stamp, ["winch"], effort + generator.normal(0.0, NOISE, 1))
        if options.tension_sensors:
            read = truth.tension[k, columns] + generator.normal(0.0, CELL_NOISE, len(CELLS))
            live.feed_tensions(stamp, CELLS, read, [CELL_NOISE] * len(CELLS))
        motor = np.round(truth.motor_angle[k] / counts[0]) * counts[0]
        joint = np.round(truth.joint_angle[k] / counts[1]) * counts[1]
        output = live.take(Sample(stamp, motor, joint))
        assert output.stddev is not None
        error[k] = output.tension - truth.tension[k]
        stddev[k] = output.stddev[:elements]
        unsure[k] = output.status != 0
    return Tracked(error, stddev, unsure, live)


FRICTIONS: Final = (0.0, 0.005, 0.01, 0.02, 0.04)
"""Friction of the motor that is not in the robot file [N m]."""
SHARES: Final = (1.0, 0.9)
"""True upper preload over that of the file."""
YIELDS: Final = (0.5e-3, 1e-3, 2.32e-3)
"""Lengths by which the upper anchor yields at once [m]."""
SEEDS: Final = (0, 1, 2)
BEGIN: Final = 17.0
"""Time of a jump [s]."""
LATER: Final = 1.3
"""The jump is later by this in every further seed [s]."""
CYCLES: Final = 10


def friction_rows(model: Model) -> Iterator[str]:
    """Errors in the last two of ten cycles, and the friction found."""
    yield "| friction of the motor | preload as in the file | upper −10 % | friction found [mN·m] |"
    yield "|---|---|---|---|"
    for friction in FRICTIONS:
        cells, found = [], []
        for share in SHARES:
            truth = moved(share, CYCLES, None)
            runs = [track(model, truth, friction, TRACKED, seed) for seed in SEEDS]
            cells.append(figures(runs, [-2 * CYCLE] * len(runs), 2 * CYCLE))
            for one in runs:
                assert one.live.fusion is not None
                found += list(one.live.fusion.sensors.motor_friction.values())
        mean, stddev = 1e3 * np.mean(found, axis=0)
        yield f"| {1e3 * friction:g} mN·m | {' | '.join(cells)} | {mean:.1f} ± {stddev:.1f} |"


def jump_rows(model: Model) -> Iterator[str]:
    """Errors before and after a jump."""
    yield "| anchor yields by | cycle before | first half cycle | second half | second cycle |"
    yield "|---|---|---|---|---|"
    for length in YIELDS:
        runs, begins = [], []
        for seed in SEEDS:
            begin = BEGIN + LATER * seed
            truth = moved(1.0, CYCLES, Fault("snap", begin, length, "upper"))
            runs.append(track(model, truth, 0.0, TRACKED, seed))
            begins.append(round(begin * RATE))
        half = CYCLE // 2
        parts = ((-CYCLE, CYCLE), (0, half), (half, half), (CYCLE, CYCLE))
        cells = [figures(runs, [begin + at for begin in begins], size) for at, size in parts]
        yield f"| {1e3 * length:g} mm | {' | '.join(cells)} |"


def calm_rows(model: Model, cycles: int) -> Iterator[str]:
    """Sudden changes that were seen although nothing happened."""
    yield "| friction of the motor | cycles | changes seen | error, within 2σ, OK |"
    yield "|---|---|---|---|"
    for friction in (0.0, 0.02):
        runs = [track(model, moved(1.0, cycles, None), friction, TRACKED, seed) for seed in SEEDS]
        seen = 0
        for one in runs:
            assert one.live.fusion is not None
            seen += sum(health.changes for health in one.live.fusion.sensors.health.values())
        cell = figures(runs, [4 * CYCLE] * len(runs), (cycles - 4) * CYCLE)
        yield f"| {1e3 * friction:g} mN·m | {cycles * len(runs)} | {seen} | {cell} |"


TRACKED: Final = Options(track_preload=True)


def figures(runs: Sequence[Tracked], begins: Sequence[int], size: int) -> str:
    """Mean error, share within two standard deviations and share with status OK, of all runs."""
    parts = [slice(begin, begin + size or None) for begin in begins]
    error = np.concatenate([np.abs(one.error[part]) for one, part in zip(runs, parts, strict=True)])
    stddev = np.concatenate([one.stddev[part] for one, part in zip(runs, parts, strict=True)])
    unsure = np.concatenate([one.unsure[part] for one, part in zip(runs, parts, strict=True)])
    inside = float(np.mean(error <= 2.0 * stddev))
    return f"{error.mean():.2f} N, {inside:.0%}, {1.0 - unsure.mean():.0%}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--only", choices=("friction", "jumps", "calm"))
    parser.add_argument("--cycles", type=int, default=60, help="cycles of the calm runs (60)")
    arguments = parser.parse_args()
    model = load_model(ROBOT)
    tables = {
        "friction": friction_rows(model),
        "jumps": jump_rows(model),
        "calm": calm_rows(model, arguments.cycles),
    }
    for name, rows in tables.items():
        if arguments.only in (None, name):
            for row in rows:
                print(row, flush=True)
            print()


if __name__ == "__main__":
    main()
