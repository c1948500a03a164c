#!/usr/bin/env python3
"""Fit few numbers to few references with a robot file that has another number wrong.

python tools/narrow_fits.py            print the table of docs/identification.md

The references are computed by the estimator itself with the true numbers, with 0.02 N of noise.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cdrj_ros.estimation.estimator import initial_state, run  # noqa: E402
from cdrj_ros.estimation.samples import Samples  # noqa: E402
from cdrj_ros.foundation.series import Series  # noqa: E402
from cdrj_ros.identification.fit import identify  # noqa: E402
from cdrj_ros.identification.observations import Recorded  # noqa: E402
from cdrj_ros.identification.problem import Settings  # noqa: E402
from cdrj_ros.identification.unknowns import fitted_along, parse_unknowns  # noqa: E402
from cdrj_ros.model.channels import channel_columns  # noqa: E402
from cdrj_ros.model.prepared import prepare  # noqa: E402
from cdrj_ros.robot.parameters import with_numbers  # noqa: E402
from cdrj_ros.robot.reader import build_robot, load_document  # noqa: E402

ROBOT = ROOT / "config" / "robots" / "prototype.yaml"
RATE = 200.0
FIT = "friction.rho,cables.{*}.preload"
CHANNELS = ("tension/*/8", "nodal_force/*/3")
CABLES = ("upper", "lower")
WRONG: dict[str, dict[str, float]] = {
    "drum radius by 1 %": {f"cables.{name}.nodes.1.radius": 0.01515 for name in CABLES},
    "EA by 5 %": {f"cables.{name}.axial_stiffness": 5970.0 for name in CABLES},
    "drag of the pulleys": {
        f"cables.{name}.nodes.{k}.bearing_torque": 0.0048 for name in CABLES for k in range(2, 9)
    },
}
"""True values of the numbers that are wrong in the file, by path."""


def motion(seconds: float) -> Samples:
    """Made-up angles of motor and joint at ``RATE``."""
    time = np.arange(round(seconds * RATE)) / RATE
    joint = 0.6 * np.sin(0.2 * np.pi * time)
    motor = 8.0 * np.sin(joint) + 0.08 * np.sin(1.7 * time)
    stamps = 1_700_000_000_000_000_000 + np.round(time * 1e9).astype(np.int64)
    return Samples(stamps, motor[:, None].copy(), joint[:, None].copy())


def errors(wrong: dict[str, float], seconds: float, *, wide: bool) -> NDArray[np.float64]:
    """Mean error of every tension after the fit, divided by its mean, shape (elements,)."""
    whole: Any = load_document(ROBOT)[0]
    document = {key: value for key, value in whole.items() if key != "uncertainty"}
    samples = motion(seconds)
    true = prepare(build_robot(with_numbers(document, wrong), "truth"))
    truth = run(true, initial_state(true), samples)[1].values
    generator = np.random.default_rng(1)
    stamps = samples.stamp_ns
    references = {}
    for name, column in channel_columns(true.layout).items():
        noise = 0.02 * generator.standard_normal(stamps.size)
        references[name] = (stamps, truth[:, column] + noise)
    recorded = Recorded(
        "made up",
        {"winch": Series(stamps, stamps, samples.motor_angle[:, 0])},
        {"elbow": Series(stamps, stamps, samples.joint_angle[:, 0])},
        references,
    )
    unknowns = parse_unknowns(document, FIT)
    if wide:
        unknowns += fitted_along(document, build_robot(document, "file").uncertainty, unknowns)
    settings = Settings(channels=CHANNELS, coarse=True)
    found = identify(document, "file", unknowns, [recorded], settings)
    fitted = prepare(build_robot(with_numbers(document, found.by_path), "fitted"))
    estimates = run(fitted, initial_state(fitted), samples)[1].values
    part = true.layout.tension
    error: NDArray[np.float64] = np.abs(estimates[:, part] - truth[:, part]).mean(axis=0)
    return error / truth[:, part].mean(axis=0)


def main() -> None:
    """Print the table."""
    print("| wrong in the file | named numbers alone | the others along |")
    print("|---|---|---|")
    for what, wrong in WRONG.items():
        found = [errors(wrong, 20.0, wide=wide) for wide in (False, True)]
        cells = [f"{100.0 * one.mean():.2g} %, {100.0 * one.max():.2g} %" for one in found]
        print(f"| {what} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
