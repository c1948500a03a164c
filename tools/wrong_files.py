#!/usr/bin/env python3
"""Estimate with a robot file that is wrong, and compare the errors with the standard deviations.

python tools/wrong_files.py            print the table of docs/estimation.md: angles alone
python tools/wrong_files.py --heard    print the table of docs/reliability.md: what sensors show
python tools/wrong_files.py --hours 3  count verdicts over hours of motion with a right file

The truth has eight contact cells per pulley and other numbers than the file.  The motion is that of
bags/prototype_preload_36_26, or random; the readings have the resolution of the file's sensors.
The motor's effort has a noise of 10 mN m, the load cells at both elements 8 of 0.1 N.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from cdrj_ros._core import mark_unsure
from cdrj_ros.estimation.changes import narrowed
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import NO_DOUBTS, Sample, Samples, initial_state, run
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.model.packing import OK
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.robot.parameters import matching_paths, number_at, with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.assembly import divide_contacts
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, random
from cdrj_ros.simulation.truth import simulate

ROOT = Path(__file__).resolve().parents[1]

ROBOT = str(ROOT / "config" / "robots" / "prototype.yaml")
BAG = str(ROOT / "bags" / "prototype_preload_36_26")
RATE = 200.0
CELLS = 8
EFFORT_NOISE = 0.01
"""Of the motor's effort [N m]."""
CELL_NOISE = 0.1
"""Of the load cells [N]."""
LAST = slice(7, None, 8)
"""Element 8 of both cables."""
TARED = ("motors.winch.reference_angle", "joints.elbow.reference_angle")
PRELOADS = ("cables.upper.preload", "cables.lower.preload")
SENSORS = (("effort",), ("cells",), ("effort", "cells"))


@dataclass(frozen=True)
class Wrong:
    """One way in which the machine differs from its file."""

    what: str
    factors: Mapping[str, float] = field(default_factory=dict)
    """Ratio of true to stated numbers, by pattern."""
    shifts: Mapping[str, float] = field(default_factory=dict)
    """True less stated numbers, by pattern [SI]."""
    zero: float = 0.0
    """Error of the joint's reading [rad]."""
    drag: float = 0.0
    """Load-independent friction of every pulley as a fraction of the preload."""
    forgets: bool = False
    """Whether the cable slips on its drum."""
    motor_friction: float = 0.0
    """Friction of the motor that is not in the file [N m]."""
    effort_sign: float = 1.0
    """Of the readings of the motor's effort."""
    broken: bool = False
    """Whether the upper cable carries nothing."""


NODES = "cables.*.nodes"
ROWS = (
    Wrong("nothing"),
    Wrong("joint zero off by 1°", zero=np.radians(1.0)),
    Wrong("drum that holds no memory of its layers", forgets=True),
    Wrong("preload crept by −10 %", {"cables.*.preload": 0.9}),
    Wrong("drum radius +0.5 mm (3 %)", shifts={f"{NODES}.1.radius": 5e-4}),
    Wrong("drag of 3 % of preload on every pulley", drag=0.03),
    Wrong("strand offset +0.5 mm", {"cables.*.spans.[6,7].sine": 60.5 / 60.0}),
    Wrong("pulley radii +0.5 mm", shifts={f"{NODES}.[2,3,4,5,6,7,8].radius": 5e-4}),
    Wrong(
        "ten small ones together",
        {
            "cables.*.youngs_modulus": 0.97, "cables.*.preload": 0.98, "friction.mu_c": 1.1,
            "friction.mu_s": 1.1, "friction.bristle_stiffness": 0.8,
            "cables.*.spans.[6,7].sine": 60.1 / 60.0,
        },
        {"friction.rho": 0.03, f"{NODES}.1.radius": 5e-5,
         f"{NODES}.[2,3,4,5,6,7,8].radius": 1e-4},
        zero=np.radians(0.1), drag=0.005,
    ),
)  # fmt: skip
"""What angles alone do not show."""

HEARD = (
    *ROWS,
    Wrong("preload of upper −10 %", {"cables.upper.preload": 0.9}),
    Wrong("preloads of both −30 %", {"cables.*.preload": 0.7}),
    Wrong("friction +50 %", {"friction.mu_c": 1.5, "friction.mu_s": 1.5}),
    Wrong("friction of the motor 40 mN·m", motor_friction=0.04),
    Wrong("upper cable broken", broken=True),
    Wrong("effort with the wrong sign", effort_sign=-1.0),
)
"""What sensors may show."""


class Truth(NamedTuple):
    """What the real machine does."""

    tension: np.ndarray
    """Of all elements [N], shape (n, elements)."""
    effort: np.ndarray
    """Of the motor [N m], shape (n, 1)."""


class Outcome(NamedTuple):
    """Figures of one estimate."""

    last: float
    """Mean error of element 8 over its mean tension [-]."""
    all: float
    """The same for all elements."""
    covered: float
    """Share of true tensions within two standard deviations."""
    ok: float
    """Share of tensions with status OK."""
    misleading: float
    """Share of tensions with status OK that lie outside two standard deviations."""


def true_motion(model, seconds):
    """Motion of the sample bag without the noise of its sensors."""
    samples = condition_recording(model, read_inputs(BAG, Topics(), model)).segments[0]
    recorded = (samples.stamp_ns - samples.stamp_ns[0]) * 1e-9
    time = np.arange(0.0, min(recorded[-1], seconds), 1.0 / RATE)
    angles = [
        gaussian_filter1d(np.interp(time, recorded, values[:, 0]), 4.0)[:, None]
        for values in (samples.motor_angle, samples.joint_angle)
    ]
    return Samples(1_000_000_000 + np.round(time * 1e9).astype(np.int64), *angles)


def reality(model, wrong):
    """The robot with its true numbers."""
    document = model.robot.document
    values = {}
    for pattern, change in {**wrong.factors, **wrong.shifts}.items():
        for path in (path for group in matching_paths(document, pattern) for path in group):
            given = number_at(document, path)
            values[path] = given * change if pattern in wrong.factors else given + change
    if wrong.drag:
        for cable in document["cables"]:
            for k, node in enumerate(cable["nodes"]):
                if node["type"] == "pulley":
                    path = f"cables.{cable['name']}.nodes.{k + 1}.bearing_torque"
                    values[path] = wrong.drag * cable["preload"] * node["radius"]
    return build_robot(with_numbers(document, values), "reality")


def true_readings(model, wrong, motion):
    """Tensions and effort of the real machine with contact cells."""
    fine = prepare(divide_contacts(reality(model, wrong), CELLS))
    slipping = np.full(len(fine.robot.cables), wrong.forgets)
    _, estimates = run(fine, initial_state(fine), motion, slipping=slipping)
    return Truth(estimates.tension, estimates.motor_effort)


def readings(model, motion, zero):
    """Encoder readings of a motion; ``zero`` is the error of the joint's reading [rad]."""
    columns = []
    for axis, angle, error in zip(
        model.robot.axes, (motion.motor_angle, motion.joint_angle), (0.0, zero), strict=True
    ):
        count = axis.sensor.resolution
        columns.append(np.round((angle + error) / count) * count)
    return Samples(motion.stamp_ns, columns[0], columns[1])


def outcome(model, known, read, true):
    """Estimate from the readings and compare with the truth."""
    ensemble = Ensemble(model, known=known)
    estimates = ensemble.follow(read, run(model, initial_state(model), read)[1])
    stddev = estimates.stddev
    elements = len(model.layout.elements)
    for values, sigma in zip(estimates.values, stddev, strict=True):
        mark_unsure(model.core, values, sigma, 0.1, NO_DOUBTS)
    error = np.abs(estimates.values[:, model.layout.tension] - true)
    inside = error <= 2.0 * stddev[:, :elements]
    ok = estimates.values[:, model.layout.status] == OK
    return Outcome(
        float(error[:, LAST].mean() / true[:, LAST].mean()),
        float(error.mean() / true.mean()),
        float(inside.mean()),
        float(ok.mean()),
        float((ok & ~inside).sum() / max(ok.sum(), 1)),
    )


def fresh_model(model):
    """The robot without the uncertainty that its file states."""
    document = {k: v for k, v in model.robot.document.items() if k != "uncertainty"}
    return prepare(build_robot(document, model.robot.source))


def row(wrong, motion):
    """Figures of a fresh file, of a tared one, of one with preloads set too, of an exact one."""
    exact = load_model(ROBOT)
    model = fresh_model(exact)
    true = true_readings(model, wrong, motion).tension
    read = readings(model, motion, wrong.zero)
    document = model.robot.document
    tared = dict.fromkeys(TARED, 0.0)
    at_rest = Samples(read.stamp_ns, read.motor_angle, read.joint_angle - wrong.zero)
    preloads = {path: number_at(document, path) for path in PRELOADS}
    for pattern, factor in wrong.factors.items():
        if pattern == "cables.*.preload":
            preloads = {path: factor * value for path, value in preloads.items()}
    fitted = prepare(build_robot(with_numbers(document, preloads), "set"))
    return [
        outcome(model, None, read, true),
        outcome(model, narrowed(model.robot, tared), at_rest, true),
        outcome(fitted, narrowed(fitted.robot, {**tared, **preloads}), at_rest, true),
        outcome(exact, None, read, true),
    ]


def sensed(model, wrong, true, motion):
    """Readings of the motor's effort and of all elements' tensions, without noise."""
    tension, effort = true.tension.copy(), true.effort
    if wrong.broken:
        lower = model.layout.elements.index("lower/1")
        tension[:, :lower] = 0.0
        effort = 0.015 * tension[:, lower : lower + 1]  # the radius of the drum [m]
    if wrong.motor_friction:
        turned = np.diff(motion.motor_angle, axis=0, prepend=motion.motor_angle[:1])
        effort = effort - wrong.motor_friction * np.tanh(turned / 1e-5)
    return Truth(tension, wrong.effort_sign * effort)


class Heard(NamedTuple):
    """Figures of an estimate that hears sensors."""

    ok: float
    """Share of tensions with status OK in the last third."""
    misleading: float
    """Share of all tensions there that have status OK but lie outside two standard deviations."""
    verdicts: list[tuple[float, str]]
    """Times [s] and words of verdicts, as they change; empty words where one is taken back."""


def heard(model, read, sensed, sensors):
    """Estimate as the node does, and compare with the truth.

    Args:
        model: the file, whose numbers are said to be exact.
        read: the encoders' readings.
        sensed: what the machine does.
        sensors: ``effort``, ``cells`` or both.
    """
    generator = np.random.default_rng(0)
    live = LiveEstimator(model)
    names = [model.layout.elements[k] for k in range(*LAST.indices(len(model.layout.elements)))]
    inside, ok, verdicts = [], [], [(0.0, "")]
    for k, stamp in enumerate(read.stamp_ns.tolist()):
        if "effort" in sensors:
            effort = sensed.effort[k] + generator.normal(0.0, EFFORT_NOISE, 1)
            live.feed_efforts(stamp, model.layout.motors, effort)
        if "cells" in sensors:
            cells = sensed.tension[k, LAST] + generator.normal(0.0, CELL_NOISE, len(names))
            live.feed_tensions(stamp, names, cells, [CELL_NOISE] * len(names))
        estimate = live.take(Sample(stamp, read.motor_angle[k], read.joint_angle[k]))
        error = np.abs(estimate.tension - sensed.tension[k])
        inside.append(error <= 2.0 * estimate.stddev[: error.size])
        ok.append(np.asarray(estimate.status) == OK)
        if k % round(RATE) == 0 and live.corrections is not None:
            report = live.corrections.report()
            words = "" if report.level == "ok" else report.message
            if words != verdicts[-1][1]:
                verdicts.append((k / RATE, words))
    late = slice(2 * len(ok) // 3, None)
    good = np.array(ok[late])
    misleading = float((good & ~np.array(inside[late])).mean())
    return Heard(float(good.mean()), misleading, verdicts[1:])


def print_stated(motion):
    """Print the table of what the file states."""
    print("| wrong | error of element 8 / all | fresh | tared | preload set too | others: exact |")
    print("|---|---|---|---|---|---|")
    for wrong in ROWS:
        found = row(wrong, motion)
        cells = [f"{one.covered:.0%}, {one.ok:.0%}" for one in found]
        print(f"| {wrong.what} | {found[0].last:.1%} / {found[0].all:.1%} | "
              f"{' | '.join(cells)} |", flush=True)  # fmt: skip


def print_heard(motion):
    """Print first and last verdicts, and what the status says in the last third."""
    exact = load_model(ROBOT)
    print("| wrong | sensors | OK | OK beyond 2 sigma | first verdict [s] | last verdict |")
    print("|---|---|---|---|---|---|")
    for wrong in HEARD:
        true = true_readings(fresh_model(exact), wrong, motion)
        read = readings(exact, motion, wrong.zero)
        for sensors in SENSORS:
            one = heard(exact, read, sensed(exact, wrong, true, motion), sensors)
            first = f"{one.verdicts[0][0]:.0f}" if one.verdicts else "-"
            print(f"| {wrong.what} | {' and '.join(sensors)} | {one.ok:.0%} | {one.misleading:.0%} "
                  f"| {first} | {one.verdicts[-1][1] if one.verdicts else ''} |",
                  flush=True)  # fmt: skip


def count_alarms(hours, seeds=6):
    """Print the verdicts over random motions with a right file."""
    model = load_model(ROBOT)
    for seed in range(seeds):
        time = np.arange(0.0, 3600.0 * hours / seeds, 1.0 / RATE)
        angle = random(np.radians(38.0), 0.5, seed)(time - 1.0)
        torque = make_load("rolling").torque(*differences(time, angle))
        truth = simulate(model.robot, time, angle, torque, 20.0, cells=4, allow_slack=True)
        stamps = 1_000_000_000 + np.round(time * 1e9).astype(np.int64)
        read = readings(model, Samples(stamps, truth.motor_angle, truth.joint_angle), 0.0)
        for sensors in SENSORS:
            one = heard(model, read, Truth(truth.tension, truth.motor_effort), sensors)
            print(f"seed {seed}, {' and '.join(sensors)}: {one.verdicts}", flush=True)


def main():
    """Print one of the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--heard", action="store_true", help="what sensors show")
    parser.add_argument("--hours", type=float, help="of motion with a right file")
    arguments = parser.parse_args()
    motion = true_motion(load_model(ROBOT), 60.0)
    if arguments.hours:
        count_alarms(arguments.hours)
    elif arguments.heard:
        print_heard(motion)
    else:
        print_stated(motion)


if __name__ == "__main__":
    main()
