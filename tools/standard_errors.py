#!/usr/bin/env python3
"""Compare the errors of identified numbers with their standard errors, on recordings of the rig.

python tools/standard_errors.py               print the figures of docs/identification.md
python tools/standard_errors.py --draws 100   the same with more recordings

Every recording has another motion of 20 s, other sensor noise and another truth with eight contact
cells per pulley; the encoders have their counts.  The numbers of the truths are drawn from the
standard deviations that the file leaves them: those that are fitted from their priors, and all
others, such as the pulleys' radii and coefficients of friction, from the defaults.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, qmc

from cdrj_ros.foundation.arrays import Series
from cdrj_ros.identification.fit import identify
from cdrj_ros.identification.nuisance import nuisance_causes
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.priors import fitted_along
from cdrj_ros.identification.problem import Settings
from cdrj_ros.identification.unknowns import Unknown, parse_unknowns
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.parameters import number_at, with_numbers
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.robot.tolerances import SPRING_SCALE, within_range
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, random, sine
from cdrj_ros.simulation.truth import simulate

ROOT = Path(__file__).resolve().parents[1]

Vector = NDArray[np.float64]

ROBOT: Final = ROOT / "config" / "robots" / "prototype.yaml"
RATE: Final = 200.0
SECONDS: Final = 20.0
CABLES: Final = ("upper", "lower")
RHO: Final = 0.05
"""Standard deviation of the true rho; the fit has no prior for it."""
DRAG: Final = 0.012
"""Bearing torque of every pulley in the file [N m]."""


def robot_file() -> Any:
    """The prototype with drag, none of whose numbers has been measured."""
    whole: Any = load_document(ROBOT)[0]
    document: Any = {key: value for key, value in whole.items() if key != "uncertainty"}
    drag = {f"cables.{c}.nodes.{k}.bearing_torque": DRAG for c in CABLES for k in range(2, 9)}
    return with_numbers(document, drag)


def fitted_numbers(document: Any, fit: str) -> tuple[Unknown, ...]:
    """The numbers that are fitted: those of a list, and what `identify` fits along."""
    unknowns = parse_unknowns(document, fit)
    return unknowns + fitted_along(document, build_robot(document, "file").uncertainty, unknowns)


def truths(document: Any, unknowns: Sequence[Unknown], draws: int) -> Iterator[dict[str, float]]:
    """True numbers by path, ``draws`` times.

    The draws of every number are spread evenly over its distribution (a Latin hypercube), so that
    few suffice.
    """
    causes = nuisance_causes(build_robot(document, "file").uncertainty, unknowns)
    size = len(unknowns) + len(causes)
    table = norm.ppf(qmc.LatinHypercube(size, seed=np.random.default_rng(0)).random(draws))
    for row in table:
        values: dict[str, float] = {}
        for unknown, x in zip(unknowns, row, strict=False):
            stddev = unknown.prior[1] if unknown.prior else SPRING_SCALE * unknown.start
            stddev = RHO if unknown.paths[0].endswith("rho") else stddev
            true = unknown.start + stddev * float(x)
            true = min(max(true, unknown.lower), unknown.upper)
            values |= dict.fromkeys(unknown.paths, true)
        for cause, x in zip(causes, row[len(unknowns) :], strict=True):
            for path, stddev in cause.items():
                change = np.array([stddev * float(x)])
                values[path] = float(within_range(document, path, change)[0])
        yield values


def moved(
    robot: Robot, seed: int, generator: np.random.Generator
) -> tuple[NDArray[np.int64], Truth, Vector, Vector]:
    """A sine or a random motion: stamps, truth, readings of the motor and of the joint [rad]."""
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    amplitude, frequency = np.radians(generator.uniform(25.0, 35.0)), generator.uniform(0.1, 0.25)
    move = (
        random(np.radians(33.0), 0.4, seed, 0.5)
        if seed % 2
        else sine(float(amplitude), float(frequency), 0.5)
    )
    angle = move(time)
    torque = make_load("rolling").torque(*differences(time, angle))
    truth = simulate(robot, time, angle, torque, 20.0, cells=8, allow_slack=True)
    stamps = 1_700_000_000_000_000_000 + np.round(time * 1e9).astype(np.int64)
    counts = [axis.sensor.resolution for axis in robot.axes]
    motor = np.round(truth.motor_angle[:, 0] / counts[0]) * counts[0]
    joint = np.round((truth.joint_angle[:, 0] - robot.offsets[1]) / counts[1]) * counts[1]
    return stamps, truth, motor, joint


def recording(document: Any, values: dict[str, float], seed: int) -> Recorded:
    """What the rig's sensors read."""
    generator = np.random.default_rng([seed, 1])
    robot = build_robot(with_numbers(document, values), "truth")
    stamps, truth, motor, joint = moved(robot, seed, generator)
    layout = prepare(robot).layout
    at = np.ascontiguousarray(stamps[::2])
    references = {}
    for kind, names, table, noise in (
        ("tension", layout.elements, truth.tension, 0.02),
        ("nodal_force", layout.pulleys, truth.nodal_force, 0.02),
        ("effort", layout.motors, truth.motor_effort, 5e-4),
        ("effort", layout.joints, truth.joint_effort, 5e-4),
    ):
        for name, column in zip(names, table[::2].T, strict=True):
            read = column + generator.normal(0.0, noise, at.size)
            references[f"{kind}/{name}"] = Series(at, at, read)
    motors = {"winch": Series(stamps, stamps, motor)}
    return Recorded("rig", motors, {"elbow": Series(stamps, stamps, joint)}, references)


def deviations(
    document: Any, unknowns: Sequence[Unknown], values: dict[str, float], seed: int
) -> Vector:
    """Errors of all fitted numbers in standard errors."""
    recorded = [recording(document, values, seed)]
    found = identify(document, "file", unknowns, recorded, Settings(coarse=True))
    real = with_numbers(document, values)
    true = np.array([number_at(real, unknown.paths[0]) for unknown in found.unknowns])
    return np.asarray((found.values - true) / found.stddev)


def main() -> None:
    """Print root mean square and share beyond 2."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--fit", default="rho,preload", help="as for identify (%(default)s)")
    arguments = parser.parse_args()
    document = robot_file()
    unknowns = fitted_numbers(document, arguments.fit)
    drawn = enumerate(truths(document, unknowns, arguments.draws))
    every = np.concatenate([deviations(document, unknowns, one, seed) for seed, one in drawn])
    beyond = np.mean(np.abs(every) > 2.0)
    print(f"root mean square {np.sqrt(np.mean(every**2)):.2f}, beyond 2: {beyond:.0%}")


if __name__ == "__main__":
    main()
