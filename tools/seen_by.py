#!/usr/bin/env python3
"""Compute the effect of changes of the prototype on the readings of its sensors.

python tools/seen_by.py                print the table of docs/uncertainty.md

The motion is that of bags/prototype_preload_36_26.  A change acts on the truth; the estimate keeps
the file's numbers.  Each figure is the deviation of a sensor's reading from this estimate.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent))

import wrong_files

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import Model, load_model, prepare

Table = NDArray[np.float64]

CHANGES = (
    wrong_files.Wrong("preload of both cables −10 %", {"cables.*.preload": 0.9}, {}),
    wrong_files.Wrong("preload of the upper cable −10 %", {"cables.upper.preload": 0.9}, {}),
    wrong_files.Wrong("joint zero off by 1°", {}, {}, zero=np.radians(1.0)),
    wrong_files.Wrong("friction +20 %", {"friction.mu_c": 1.2, "friction.mu_s": 1.2}, {}),
    wrong_files.Wrong("drag of 3 % of preload on every pulley", {}, {}, drag=0.03),
    wrong_files.Wrong("drum radius +0.5 mm (3 %)", {}, {"cables.*.nodes.1.radius": 5e-4}),
    wrong_files.Wrong("cable slips on its drum", {}, {}, forgets=True),
    wrong_files.Wrong(
        "upper cable broken",
        {"cables.upper.preload": 0.0, "cables.upper.youngs_modulus": 1e-9},
        {},
    ),
)


def readings_of(model: Model, wrong: wrong_files.Wrong, motion: Samples) -> Table:
    """Motor effort, joint effort [N m], upper/8 and lower/8 [N] of the changed machine, (n, 4)."""
    real = prepare(wrong_files.reality(model, wrong), check_range=False)
    layout = real.layout
    if wrong.zero:  # the true angle is less than the reading
        motion = Samples(motion.stamp_ns, motion.motor_angle, motion.joint_angle - wrong.zero)
    rows = run(real, initial_state(real), motion, slipping=wrong.forgets)[1].values
    columns = [
        layout.motor_effort.start, layout.joint_effort.start,
        layout.tension.start + 7, layout.tension.start + 15,
    ]  # fmt: skip
    return rows[:, columns]


def _rms(values: Table) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    """Print the table."""
    model = load_model(wrong_files.ROBOT)
    motion = wrong_files.true_motion(model, 60.0)
    speed = np.gradient(motion.joint_angle[:, 0])
    forward, back = speed > 1e-4, speed < -1e-4
    expected = readings_of(model, wrong_files.Wrong("nothing", {}, {}), motion)
    print(
        "| change | motor effort, mean [mN·m] | its hysteresis [mN·m] "
        "| joint effort, mean [mN·m] | "
        "load cell, upper/8, RMS [N] | sum of both cells, RMS [N] |"
    )
    print("|---|---|---|---|---|---|")
    for wrong in CHANGES:
        change = readings_of(model, wrong, motion) - expected
        width = change[forward, 0].mean() - change[back, 0].mean()
        cells = (
            f"{1e3 * change[:, 0].mean():+.0f}", f"{1e3 * width:+.0f}",
            f"{1e3 * change[:, 1].mean():+.0f}", f"{_rms(change[:, 2]):.1f}",
            f"{_rms(change[:, 2:].sum(axis=1)):.1f}",
        )  # fmt: skip
        print(f"| {wrong.what} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
