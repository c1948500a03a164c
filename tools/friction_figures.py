#!/usr/bin/env python3
"""Draw docs/figures/drift.png: why the default friction law is not LuGre.

python tools/friction_figures.py
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from pathlib import Path

import matplotlib as mpl
import numpy as np

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.sensors import JOINT_ENCODER

TARGET = Path(__file__).parents[1] / "docs" / "figures" / "drift.png"
LAWS = {"lugre": "#d55e00", "elastoplastic": "#0072b2"}
"""Laws and their colours, after Okabe and Ito."""

ONE_PULLEY = """
name: one_pulley
motors: [{name: m}]
joints: [{name: q, range: [-0.7, 0.7]}]
friction: {law: elastoplastic, mu_c: 0.15, bristle_stiffness: 1.0e+6}
cables:
  - name: c
    axial_stiffness: 6283
    preload: 30
    nodes:
      - {type: winch, motor: m, winding: 1, radius_mm: 15}
      - {type: pulley, radius_mm: 11, wrap_angle_deg: 105.4}
      - {type: anchor}
    spans: [0.3, {joint: q, offset: 0.3, sine: -0.06}]
"""


def held(law: str) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and friction [N] of a held pulley while the joint jitters by a count."""
    time = np.arange(30_000) / 500.0
    motor = 0.1 * np.clip(time / 2.0, 0.0, 1.0) - 0.02 * np.clip((time - 2.5) / 1.0, 0.0, 1.0)
    tremble = np.random.default_rng(1).normal(0.0, 1e-4, time.size) * (time > 5.0)
    step = 2.0 * pi / JOINT_ENCODER.counts
    joint = np.round(tremble / step + 0.4) * step  # 0.4: at rest between two counts
    robot = parse_robot(ONE_PULLEY)
    model = prepare(replace(robot, cables=tuple(replace(one, law=law) for one in robot.cables)))
    stamps = 1 + np.round(time * 1e9).astype(np.int64)
    samples = Samples(stamps, motor[:, None], joint[:, None])
    estimates = run(model, initial_state(model), samples)[1]
    return time, estimates.friction[:, 0]


def main() -> None:
    """Draw the figure and print the measured values."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    figure, axes = plt.subplots(figsize=(4.6, 2.9), layout="constrained")
    for law, colour in LAWS.items():
        time, friction = held(law)
        shown = time >= 3.5
        axes.plot(time[shown], friction[shown], color=colour, linewidth=1.0, label=law)
        print(f"{law}: friction {friction[2400]:.3f} N before, {friction[-1]:.3f} N after 55 s")
    axes.axvline(5.0, color="0.6", linewidth=0.8, linestyle=":")
    axes.set(xlabel="time [s]", ylabel="friction of the pulley [N]", ylim=(-7.6, 1.0))
    axes.legend(frameon=False)
    figure.savefig(TARGET, dpi=150)


if __name__ == "__main__":
    main()
