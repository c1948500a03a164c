#!/usr/bin/env python3
"""What the steps of ``commission`` bring, over truths with three mismatches.

python tools/commission_table.py prototype --draws 20    the rig, whose joint a motor balances
python tools/commission_table.py wrist --draws 20        four cables in space, three joints

Three causes of error are drawn for every truth among the documented defaults, each with its own
standard deviation.  The truth has eight contact cells per pulley.  It is recorded at rest, and for
60 s with the motors' efforts (noise 20 mN m, of the wrist 2 mN m) and load cells (0.1 N); spring
scale (3 %: a gain common to all readings, and 1 % in each) and calliper (0.05 mm) err as the file
then says.  The scale is read in the reference pose, then near the ends of all joints' ranges and,
after five motions to and fro, in the reference pose again.  Angles are read 500 times a second,
motors and joints in one message, as joint_state_broadcaster publishes them.  The file of every step
is then judged on another motion.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from cdrj_ros.commands import commission_steps as steps
from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.identification.observations import Recorded, samples_of
from cdrj_ros.identification.poses import rest_poses
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Winch
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.robot.tolerances import default_tolerances, within_range
from cdrj_ros.robot.writer import with_section
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, random
from cdrj_ros.simulation.sensors import reading_of
from cdrj_ros.simulation.truth import simulate

ROOT = Path(__file__).resolve().parents[1]

MISMATCHES = 3
SECONDS = 60.0
RATE = 500.0
INERTIA_S = 0.01
"""Standard deviation of the smoothing of a balancing motor [s].  Without inertia it would cross the
friction of the cables at a reversal, 1.4 degrees, between two readings, as a slip does."""
PULL = 0.05
"""Angle by which every motor of the wrist turns beyond what the joints ask for [rad]."""
START_S = 5.0
"""Beginning of a judged motion, in which the friction history is unknown [s]."""
EFFORT_NOISE = {"prototype": 0.02, "wrist": 0.002}
"""Standard deviation of the motors' efforts [N m]: some 5 % of what the preloads make of them."""
CELL_NOISE = 0.1
SCALE_GAIN = 0.0283
SCALE_NOISE = 0.01
POSES = {"prototype": ((-0.8,), (0.8,)),
                "wrist": ((-0.8, -0.8, -0.8), (0.8, 0.8, 0.8), (0.8, -0.8, 0.8))}  # fmt: skip
"""Further poses for the spring scale, as fractions of the ranges beside the reference pose."""
MOVE_S, REST_S, CYCLES = 2.5, 3.0, 5
CALLIPER_NOISE = 5e-5
EPOCH_NS = 1_700_000_000_000_000_000


def drawn(document, seed):
    """A possible truth, and what differs from the file."""
    generator = np.random.default_rng([seed, 7])
    causes = default_tolerances(document)
    while True:
        chosen = [causes[k] for k in generator.choice(len(causes), MISMATCHES, replace=False)]
        values = {}
        for cause in chosen:
            size = float(generator.standard_normal())
            for path, stddev in cause.factor.items():
                change = np.array([size * stddev])
                values[path] = float(within_range(document, path, change)[0])
        truth = with_numbers(document, values)
        try:
            prepare(build_robot(truth, "truth"))
        except RobotFileError:  # two pulleys overlap, for instance
            continue
        return truth, [cause.what for cause in chosen]


def moved(robot, seed):
    """A random motion over most of the joints' ranges, and what the encoders read."""
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    if len(robot.joints) == 1:
        angle = random(np.radians(33.0), 0.3, seed, 0.5)(time)
        torque = make_load("rolling").torque(*differences(time, angle))
        free = simulate(robot, time, angle, torque, 20.0, allow_slack=True)
        motors = gaussian_filter1d(free.motor_angle, INERTIA_S * RATE, axis=0, mode="nearest")
        joints = free.joint_angle
    else:
        joints = np.stack(
            [
                random(0.4 * (joint.upper - joint.lower), 0.3, seed + 100 * k)(time - 0.5)
                for k, joint in enumerate(robot.joints)
            ],
            axis=1,
        )
        motors = follow_joints(prepare(robot), joints).motor_angle
        for k in range(len(robot.motors)):  # a controller changes the tensions by some 4 N
            motors[:, k] += random(PULL, 0.5, seed + 1000 + k)(time - 0.5)
    return _read(robot, time, joints, motors)


def _read(robot, time, joints, motors):
    """The readings of all encoders in a motion, and its truth."""
    truth = simulate(robot, time, joints, motor_angle=motors, allow_slack=True)
    stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    found = []
    for axes, angles in ((robot.motors, truth.motor_angle), (robot.joints, truth.joint_angle)):
        own = {}
        for axis, angle in zip(axes, angles.T, strict=True):
            count = axis.sensor.resolution or 1e-5
            reading = np.round(reading_of(axis.sensor, angle) / count) * count
            own[axis.name] = Series(stamps, stamps, reading)
        found.append(own)
    return Recorded("motion", *found, {}), truth


def recordings(robot, seed):
    """In motion with efforts; the same with the load cells of the first two cables, too."""
    generator = np.random.default_rng([seed, 8])
    motion, truth = moved(robot, seed)
    at = np.ascontiguousarray(stamps_of(motion)[::2])
    layout = prepare(robot).layout

    def heard(column, noise):
        return Series(at, at, column[::2] + generator.normal(0.0, noise, at.size))

    references = {
        f"effort/{name}": heard(column, EFFORT_NOISE[robot.name])
        for name, column in zip(layout.motors, truth.motor_effort.T, strict=True)
    }
    yield replace(motion, references=dict(references))
    for cable in robot.cables[:2]:
        cell = cable.element_names[-1]
        column = truth.tension[:, layout.elements.index(cell)]
        references[f"tension/{cell}"] = heard(column, CELL_NOISE)
    yield replace(motion, references=references)


def in_poses(robot):
    """At rest in one pose after the other, where a spring scale can be read, and on the ways."""
    joints, here = robot.joints, robot.reference_pose
    ends = here - [joint.lower for joint in joints], [joint.upper for joint in joints] - here
    parts = [np.tile(here, (round(REST_S * RATE), 1))]
    count = round(MOVE_S * RATE)
    way = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, count + 1) / count)[:, None]
    poses = [np.array(pose) for pose in POSES[robot.name]]
    to_and_fro = CYCLES * poses[:2]
    for k, share in enumerate((*poses, *to_and_fro, 0.0 * poses[0])):
        goal = here + share * np.where(share > 0.0, ends[1], ends[0])
        parts.append(parts[-1][-1] + (goal - parts[-1][-1]) * way)
        if not len(poses) <= k < len(poses) + len(to_and_fro):
            parts.append(np.tile(goal, (round(REST_S * RATE), 1)))
    angles = np.concatenate(parts)
    time = np.arange(len(angles)) / RATE
    motors = follow_joints(prepare(robot), angles).motor_angle
    return _read(robot, time, angles, motors)


def scale_read(robot, recorded, truth, generator):
    """What a spring scale reads at the last element of every cable, in every pose."""
    gain = 1.0 + SCALE_GAIN * float(generator.standard_normal())
    layout = prepare(robot).layout
    ends = [cable.element_names[-1] for cable in robot.cables]
    columns = [layout.elements.index(end) for end in ends]
    found = []
    samples = samples_of(prepare(robot), recorded)
    for pose in rest_poses(robot, samples, recorded.name):
        at = round((pose.stamp_ns - EPOCH_NS) * 1e-9 * RATE)
        errors = gain * (1.0 + SCALE_NOISE * generator.standard_normal(len(ends)))
        values = truth.tension[at, columns] * errors
        found.append(dict(zip(ends, values.tolist(), strict=True)))
    return found


def stamps_of(recorded):
    """Of all readings [ns]."""
    return next(iter(recorded.motors.values())).stamp_ns


class Figures(NamedTuple):
    """How a file does on another motion."""

    ok: float
    covered: float
    relative: float
    """Median of standard deviation over tension."""
    false2: float
    """Share of the tensions with status OK that are off by more than two standard deviations."""
    false5: float
    error: float


def compared(model, other):
    """Estimates of another motion beside the truth."""
    motion, truth = other
    conditioned = condition(model.robot, motion.motors, motion.joints)
    found = estimate(model, conditioned, uncertainty=True)
    stamps = found.stamp_ns
    late = stamps >= stamps_of(motion)[0] + round(START_S * 1e9)
    true = np.stack(
        [np.interp(stamps, stamps_of(motion), column) for column in truth.tension.T], axis=1
    )[late]
    elements = true.shape[1]
    values, stddev = found.values[late], found.stddev[late][:, :elements]
    error = np.abs(values[:, model.layout.tension] - true)
    ok = values[:, elements : 2 * elements] == 0.0
    off = error / np.maximum(stddev, 1e-12)
    return Figures(
        float(ok.mean()), float(np.mean(off <= 2.0)),
        float(np.median(stddev / np.maximum(true, 1e-6))),
        float(np.mean(ok & (off > 2.0))), float(np.mean(ok & (off > 5.0))),
        float(np.mean(error / np.maximum(true, 1.0))),
    )  # fmt: skip


def course(name, seed):
    """The steps for one truth, from a shipped robot file without a statement on its accuracy."""
    source = ROOT / "config" / "robots" / f"{name}.yaml"
    text = with_section(source.read_text(encoding="utf-8"), "uncertainty", None)
    now = steps.begin(text, str(source))
    truth, wrong = drawn(now.model.robot.document, seed)
    robot = build_robot(truth, "truth")
    other = moved(robot, seed + 50_000)
    generator = np.random.default_rng([seed, 9])
    poses, truth_there = in_poses(robot)
    readings = scale_read(robot, poses, truth_there, generator)
    print(f"  {seed}: {', '.join(wrong)}", flush=True)
    yield "fresh", compared(now.model, other)
    now = now.also(rest=poses)
    yield "tare, preloads", compared(now.also(preload=readings[:1]).model, other)
    now = now.also(preload=readings)
    yield "in three poses", compared(now.model, other)
    drums = {
        node.motors[0][0]: 2.0 * (node.radius + CALLIPER_NOISE * float(generator.standard_normal()))
        for cable in robot.cables
        for node in cable.nodes
        if isinstance(node, Winch)
    }
    now = now.also(drum=drums)
    yield "+ drums", compared(now.model, other)
    for what, recorded in zip(("+ efforts", "+ two cells"), recordings(robot, seed), strict=True):
        yield what, compared(now.also(motion=[recorded]).model, other)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("robot", choices=("prototype", "wrist"))
    parser.add_argument("--draws", type=int, default=20)
    arguments = parser.parse_args()
    rows = {}
    for seed in range(arguments.draws):
        for what, figures in course(arguments.robot, seed):
            rows.setdefault(what, []).append(figures)
    print("| after | OK | within 2σ (worst) | σ/T | OK and beyond 2σ (worst) | beyond 5σ | error |")
    print("|---|---|---|---|---|---|---|")
    for what, found in rows.items():
        mean, worst = Figures(*np.mean(found, axis=0)), Figures(*np.max(found, axis=0))
        least = min(one.covered for one in found)
        print(
            f"| {what} | {mean.ok:.0%} | {mean.covered:.0%} ({least:.0%}) | {mean.relative:.1%} "
            f"| {mean.false2:.1%} ({worst.false2:.1%}) | {mean.false5:.2%} | {mean.error:.1%} |"
        )


if __name__ == "__main__":
    main()
