#!/usr/bin/env python3
"""Compare the errors of identified numbers with their standard errors, on recordings of the rig.

python tools/standard_errors.py              print the table of docs/identification.md
python tools/standard_errors.py --seeds 10   the same with more recordings

Every recording has another motion of 20 s, other sensor noise and a truth whose numbers differ from
the file's by random draws of their default standard deviations; the truth has eight contact cells
per pulley, the encoders their counts.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cdrj_ros.foundation.series import Series  # noqa: E402
from cdrj_ros.identification.fit import Settings, identify  # noqa: E402
from cdrj_ros.identification.residuals import Recorded  # noqa: E402
from cdrj_ros.identification.unknowns import parse_unknowns  # noqa: E402
from cdrj_ros.identification.wide import fitted_along  # noqa: E402
from cdrj_ros.model.joint import RollingLoad  # noqa: E402
from cdrj_ros.model.prepared import prepare  # noqa: E402
from cdrj_ros.rig.motion import random, sine  # noqa: E402
from cdrj_ros.rig.truth import simulate  # noqa: E402
from cdrj_ros.robot.parameters import number_at, with_numbers  # noqa: E402
from cdrj_ros.robot.reader import build_robot, load_document  # noqa: E402

Vector = NDArray[np.float64]

ROBOT: Final = ROOT / "config" / "robots" / "prototype.yaml"
RATE: Final = 200.0
SECONDS: Final = 20.0
CABLES: Final = ("upper", "lower")
FIT: Final = "rho,preload"
FEW: Final = ("tension/*/8", "nodal_force/*/3")
DRAG: Final = 0.004
"""Bearing torque of every pulley, in the file and in the truth [N m]."""
ZERO: Final = "joints.elbow.reference_angle"
CASES: Final = {
    "drawn": "all drawn",
    "drum": "drum ± 0.5 mm",
    "preload": "preloads ± 10 %",
    "zero": "reading of the joint ± 0.2°",
}
KINDS: Final = {
    "ρ": "rho", "preload": "preload", "EA": "axial_stiffness", "drum": "radius", "zero": ZERO,
    "drag": "bearing_torque",
}  # fmt: skip


def truth_of(case: str, generator: np.random.Generator) -> tuple[dict[str, float], float]:
    """True numbers by path, and the error of the joint's reading [rad]."""
    normal = np.clip(generator.standard_normal(8), -2.0, 2.0)
    signs = generator.choice([-1.0, 1.0], 2)
    off = signs * 0.1 if case == "preload" else 0.1 * normal[1:3]
    radius = 0.015 + (5e-4 * signs[0] if case == "drum" else 2.5e-4 * normal[0])
    values = {ZERO: float(np.radians(normal[5]))}
    for k, (cable, preload) in enumerate(zip(CABLES, (36.85, 26.26), strict=True)):
        values |= {
            f"cables.{cable}.nodes.1.radius": float(radius),
            f"cables.{cable}.preload": float(preload * (1.0 + off[k])),
            f"cables.{cable}.youngs_modulus": float(200e9 * (1.0 + 0.1 * normal[3 + k])),
            f"cables.{cable}.friction.rho": float(0.2 + 0.05 * normal[6 + k]),
        }
    return values, float(signs[0] * np.radians(0.2)) if case == "zero" else 0.0


def recording(document: Any, values: dict[str, float], zero: float, seed: int) -> Recorded:
    """What the rig's sensors read."""
    generator = np.random.default_rng([seed, 1])
    robot = build_robot(with_numbers(document, values), "truth")
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    amplitude, frequency = np.radians(generator.uniform(25.0, 35.0)), generator.uniform(0.1, 0.25)
    move = (
        random(np.radians(33.0), 0.4, seed, 0.5)
        if seed % 2
        else sine(float(amplitude), float(frequency), 0.5)
    )
    course = move(time)
    torque = RollingLoad().torque(course.angle, course.speed, course.acceleration)
    truth = simulate(robot, time, course.angle, torque, 20.0, cells=8, allow_slack=True)
    stamps = 1_700_000_000_000_000_000 + np.round(time * 1e9).astype(np.int64)
    counts = [axis.sensor.resolution for axis in robot.axes]
    motor = np.round(truth.motor_angle[:, 0] / counts[0]) * counts[0]
    joint = np.round((truth.joint_angle[:, 0] + zero) / counts[1]) * counts[1]
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
            references[f"{kind}/{name}"] = (at, column + generator.normal(0.0, noise, at.size))
    motors = {"winch": Series(stamps, stamps, motor)}
    return Recorded("rig", motors, {"elbow": Series(stamps, stamps, joint)}, references)


def deviations(case: str, channels: tuple[str, ...], seed: int) -> dict[str, list[float]]:
    """Errors of all fitted numbers in standard errors, by kind."""
    whole: Any = load_document(ROBOT)[0]
    document: Any = {key: value for key, value in whole.items() if key != "uncertainty"}
    drag = {f"cables.{c}.nodes.{k}.bearing_torque": DRAG for c in CABLES for k in range(2, 9)}
    document = with_numbers(document, drag)
    values, zero = truth_of(case, np.random.default_rng([seed, 0]))
    unknowns = parse_unknowns(document, FIT)
    unknowns += fitted_along(document, build_robot(document, "file").uncertainty, unknowns)
    settings = Settings(channels=channels, coarse=True, starts=3 if channels else 1)
    found = identify(
        document, "file", unknowns, [recording(document, values, zero, seed)], settings
    )
    real = with_numbers(document, values)
    result: dict[str, list[float]] = {}
    for unknown, value, stddev in zip(found.unknowns, found.values, found.stddev, strict=True):
        true = number_at(real, unknown.paths[0]) + (zero if unknown.paths[0] == ZERO else 0.0)
        kind = next(name for name, part in KINDS.items() if part in unknown.paths[0])
        result.setdefault(kind, []).append(float((value - true) / stddev))
    return result


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5)
    seeds = parser.parse_args().seeds
    print(f"| truth | references | {' | '.join(KINDS)} | beyond 2 |")
    print("|---|---|" + "---|" * (len(KINDS) + 1))
    for case, words in CASES.items():
        for name, channels in (("32", ()), ("4", FEW)):
            found = [deviations(case, channels, seed) for seed in range(seeds)]
            every = {kind: np.concatenate([one[kind] for one in found]) for kind in KINDS}
            cells = [f"{np.sqrt(np.mean(z**2)):.2f}" for z in every.values()]
            beyond = float(np.mean(np.abs(np.concatenate(list(every.values()))) > 2.0))
            print(f"| {words} | {name} | {' | '.join(cells)} | {beyond:.0%} |", flush=True)


if __name__ == "__main__":
    main()
