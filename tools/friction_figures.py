#!/usr/bin/env python3
"""Draw docs/figures/drift.png: why the default friction law is not LuGre.

python tools/friction_figures.py [--out docs/figures]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from math import pi
from pathlib import Path

import matplotlib as mpl
import numpy as np

from cdrj_ros.estimation.estimator import Estimates, Samples, initial_state, run
from cdrj_ros.foundation.output import ProgressBar
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Robot, Sensor
from cdrj_ros.robot.reader import load_robot, parse_robot
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.sensors import JOINT_ENCODER, MOTOR_ENCODER, counted
from cdrj_ros.simulation.truth import simulate

ROOT = Path(__file__).parents[1]
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


def with_law(robot: Robot, law: str) -> Robot:
    """The same robot with one friction law for all cables."""
    return replace(robot, cables=tuple(replace(cable, law=law) for cable in robot.cables))


def estimated(robot: Robot, time: np.ndarray, motor: np.ndarray, joint: np.ndarray) -> Estimates:
    """Run the estimator on encoder readings."""
    model = prepare(robot)
    stamps = 1 + np.round(time * 1e9).astype(np.int64)
    return run(model, initial_state(model), Samples(stamps, motor[:, None], joint[:, None]))[1]


def held(law: str) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and friction [N] of a held pulley while the joint jitters by a count."""
    time = np.arange(30_000) / 500.0
    motor = 0.1 * np.clip(time / 2.0, 0.0, 1.0) - 0.02 * np.clip((time - 2.5) / 1.0, 0.0, 1.0)
    tremble = np.random.default_rng(1).normal(0.0, 1e-4, time.size) * (time > 5.0)
    step = 2.0 * pi / JOINT_ENCODER.counts
    joint = np.round(tremble / step + 0.4) * step  # 0.4: at rest between two counts
    estimates = estimated(with_law(parse_robot(ONE_PULLEY), law), time, motor, joint)
    return time, estimates.values[:, estimates.layout.friction][:, 0]


def on_the_rig(law: str, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], and error of upper/8 [N] with ideal and with quantised readings of the rig."""
    robot = with_law(load_robot(ROOT / "config" / "robots" / "prototype.yaml"), law)
    time = np.arange(round(duration * 1000.0) + 1) / 1000.0
    moving = np.maximum(time - 1.0, 0.0)
    share = np.minimum(moving * 0.1, 1.0)
    angle = np.radians(38.0) * share**2 * (3.0 - 2.0 * share) * np.sin(0.2 * pi * moving)
    speed = np.gradient(angle, time)
    torque = make_load("rolling").torque(angle, speed, np.gradient(speed, time))
    with ProgressBar(f"simulating, {law}", time.size) as report:
        truth = simulate(robot, time, angle, torque, progress=report)
    motor = np.reshape(truth.motor_angle, (time.size, -1))[:, 0]
    joint = np.reshape(truth.joint_angle, (time.size, -1))[:, 0]
    times = np.arange(int(duration * JOINT_ENCODER.rate + 1e-9) + 1) / JOINT_ENCODER.rate
    true = np.interp(times, time, truth.tension[:, 7])
    motor, joint = np.interp(times, time, motor), np.interp(times, time, joint)
    exact = estimated(robot, times, motor, joint)
    coarse = estimated(
        robot,
        times,
        counted(MOTOR_ENCODER, motor, 0.0, Sensor()),
        counted(JOINT_ENCODER, joint, 0.0, Sensor()),
    )
    column = exact.layout.tension.start + 7
    return times, exact.values[:, column] - true, coarse.values[:, column] - true


def main() -> None:
    """Draw the figure and print the measured values."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures")
    parser.add_argument("--duration", type=float, default=61.0, help="of the rig's run [s]")
    arguments = parser.parse_args()
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 2.9), layout="constrained")
    for law, colour in LAWS.items():
        time, friction = held(law)
        shown = time >= 3.5
        left.plot(time[shown], friction[shown], color=colour, linewidth=1.0, label=law)
        print(f"{law}: friction {friction[2400]:.3f} N before, {friction[-1]:.3f} N after 55 s")
    left.axvline(5.0, color="0.6", linewidth=0.8, linestyle=":")
    left.set_ylim(-7.6, 1.0)
    left.set(xlabel="time [s]", ylabel="friction of the pulley [N]")
    left.set_title("(a) pulley held, joint trembles by a count", loc="left", fontsize=9)
    for law, colour in LAWS.items():
        times, exact, counted = on_the_rig(law, arguments.duration)
        right.plot(times, counted, color=colour, linewidth=0.8, label=law)
        print(
            f"{law}: mean |error| of upper/8 {np.abs(exact).mean():.3f} N ideal, "
            f"{np.abs(counted).mean():.3f} N counted"
        )
    right.axhline(0.0, color="0.6", linewidth=0.8, linestyle=":")
    right.set(xlabel="time [s]", ylabel="error of element 8 [N]")
    right.set_title("(b) rig, 14-bit joint encoder", loc="left", fontsize=9)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    arguments.out.mkdir(parents=True, exist_ok=True)
    target = arguments.out / "drift.png"
    figure.savefig(target, dpi=200)
    print(target)


if __name__ == "__main__":
    main()
