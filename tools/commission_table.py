#!/usr/bin/env python3
"""What the steps of ``commission`` bring, over truths with three mismatches.

python tools/commission_table.py prototype --draws 20    the rig, whose joint a motor balances
python tools/commission_table.py wrist --draws 20        four cables in space, three joints
python tools/commission_table.py finger --draws 20       three cables, two joints, see below

Three causes of error are drawn for every truth among the documented defaults, each with its own
standard deviation.  The truth has eight contact cells per pulley.  It is recorded at rest, and for
60 s with the motors' efforts (noise 20 mN m, of the wrist 2 mN m) and load cells (0.1 N); spring
scale (3 %: a gain common to all readings, and 1 % in each) and calliper (0.05 mm) err as the file
then says.  The scale is read in the reference pose, then near the ends of all joints' ranges and,
after five motions to and fro, in the reference pose again.  Angles are read 500 times a second,
motors and joints in one message, as joint_state_broadcaster publishes them.  The file of every step
is then judged on another motion.

The finger is commissioned by a tare, preloads in one pose and a motion alone, each draw by another
of ``WAYS``: random, sine or dwell, of both joints or one, at 1000 or 200 Hz, with torques (3 mN m)
or currents, whose factor is 3 % off.  It is judged on random motions of both joints, also live: by
the estimator that hears the efforts, whose share of OK is compared with what commission foretells.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from cdrj_ros.api import Estimator
from cdrj_ros.commands import commission_steps as steps
from cdrj_ros.commands.commission_judged import foretold, judged
from cdrj_ros.commands.commission_rests import rest_poses
from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.estimator import Estimates
from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.identification.observations import Recorded, samples_of
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot, Winch
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot, load_document
from cdrj_ros.robot.tolerances import Tolerance, default_tolerances, within_range
from cdrj_ros.robot.writer import with_section
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.drives import follow_joints
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.motion import differences, named_motion, random
from cdrj_ros.simulation.truth import simulate

ROOT = Path(__file__).resolve().parents[1]

Vector = NDArray[np.float64]

MISMATCHES: Final = 3
SECONDS: Final = 60.0
RATE: Final = 500.0
INERTIA_S: Final = 0.01
"""Standard deviation of the smoothing of a balancing motor [s].  Without inertia it would cross the
friction of the cables at a reversal, 1.4 degrees, between two readings, as a slip does."""
PULL: Final = 0.05
"""Angle by which every motor of the wrist turns beyond what the joints ask for [rad]."""
START_S: Final = 5.0
"""Beginning of a judged motion, in which the friction history is unknown [s]."""
EFFORT_NOISE: Final = {"prototype": 0.02, "wrist": 0.002, "finger": 0.003}
"""Standard deviation of the motors' efforts [N m]: some 5 % of what the preloads make of them."""
CELL_NOISE: Final = 0.1
SCALE_GAIN: Final = 0.0283
SCALE_NOISE: Final = 0.01
POSES: Final = {"prototype": ((-0.8,), (0.8,)),
                "wrist": ((-0.8, -0.8, -0.8), (0.8, 0.8, 0.8), (0.8, -0.8, 0.8))}  # fmt: skip
"""Further poses for the spring scale, as fractions of the ranges beside the reference pose."""
MOVE_S, REST_S, CYCLES = 2.5, 3.0, 5
CALLIPER_NOISE: Final = 5e-5
WAYS: Final = tuple(product(("random", "sine", "dwell"), (2, 1), (1000.0, 200.0), (False, True)))
"""Motion, joints that move, rate [Hz] and whether efforts are currents, for the finger."""
CURRENT: Final = 0.03
"""Standard deviation of the factor from a current to a torque, as of catalogues."""
EPOCH_NS: Final = 1_700_000_000_000_000_000


def file_text(name: str, hold: bool) -> str:
    """A shipped robot file with no statement on its accuracy but that the drums hold."""
    text = (ROOT / "config" / "robots" / f"{name}.yaml").read_text(encoding="utf-8")
    return with_section(text, "uncertainty", "uncertainty: {drums: hold}" if hold else None)


def drawn(document: Any, seed: int) -> tuple[Any, list[str]]:
    """A possible truth, and what differs from the file."""
    generator = np.random.default_rng([seed, 7])
    causes = default_tolerances(document)
    while True:
        truth, wrong = _draw(document, causes, generator)
        try:
            prepare(build_robot(truth, "truth"))
        except RobotFileError:  # two pulleys overlap, for instance
            continue
        return truth, wrong


def _draw(
    document: Any, causes: Sequence[Tolerance], generator: np.random.Generator
) -> tuple[Any, list[str]]:
    chosen = generator.choice(len(causes), MISMATCHES, replace=False)
    values: dict[str, float] = {}
    for k in chosen.tolist():
        size = float(generator.standard_normal())
        for path, stddev in causes[k].factor.items():
            change = np.array([size * stddev])
            values[path] = float(within_range(document, path, change)[0])
    return with_numbers(document, values), [causes[k].what for k in chosen.tolist()]


class Moved(NamedTuple):
    """A motion of the truth."""

    stamp_ns: NDArray[np.int64]
    truth: Truth
    motors: dict[str, Series]
    joints: dict[str, Series]


def finger_moved(robot: Robot, seed: int, kind: str, moving: int, rate: float) -> Moved:
    """A motion of the finger's first joints, the others at rest in their reference pose."""
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    joints = np.tile([joint.reference_angle for joint in robot.joints], (time.size, 1))
    for k, joint in enumerate(robot.joints[:moving]):
        amplitude = 0.45 * (joint.upper - joint.lower)
        middle = 0.5 * (joint.upper + joint.lower)
        frequency = {"random": 0.5, "sine": 0.2 + 0.07 * k, "dwell": 0.1 + 0.03 * k}[kind]
        joints[:, k] = named_motion(kind, amplitude, frequency, seed + 100 * k, 0.5, middle)(time)
    motors = follow_joints(prepare(robot), joints).motor_angle
    truth = simulate(robot, time, joints, motor_angle=motors, allow_slack=True)
    stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    return Moved(stamps, truth, *_read(robot, stamps, truth.motor_angle, truth.joint_angle))


def with_efforts(robot: Robot, motion: Moved, currents: bool, seed: int) -> Recorded:
    """The motion with the motors' efforts, as torques or as currents with an unknown factor."""
    generator = np.random.default_rng([seed, 10])
    size = motion.truth.motor_effort.shape
    factor = 1.0 + (CURRENT * generator.standard_normal(size[1]) if currents else 0.0)
    read = factor * motion.truth.motor_effort
    read += generator.normal(0.0, EFFORT_NOISE[robot.name], size)
    efforts = {
        f"effort/{motor.name}": Series(motion.stamp_ns, motion.stamp_ns, column.copy())
        for motor, column in zip(robot.motors, read.T, strict=True)
    }
    return Recorded("motion", motion.motors, motion.joints, efforts)


def moved(robot: Robot, seed: int) -> Moved:
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
                random(0.4 * (joint.upper - joint.lower), 0.3, seed + 100 * k, 0.5)(time)
                for k, joint in enumerate(robot.joints)
            ],
            axis=1,
        )
        motors = follow_joints(prepare(robot), joints).motor_angle
        for k in range(len(robot.motors)):  # a controller changes the tensions by some 4 N
            motors[:, k] += random(PULL, 0.5, seed + 1000 + k, 0.5)(time)
    truth = simulate(robot, time, joints, motor_angle=motors, allow_slack=True)
    stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    return Moved(stamps, truth, *_read(robot, stamps, truth.motor_angle, truth.joint_angle))


def _read(
    robot: Robot, stamps: NDArray[np.int64], motors: Vector, joints: Vector
) -> tuple[dict[str, Series], dict[str, Series]]:
    """Readings of all encoders."""
    found: list[dict[str, Series]] = []
    for axes, angles in ((robot.motors, motors), (robot.joints, joints)):
        own = {}
        for axis, angle in zip(axes, angles.T, strict=True):
            reading = (angle - axis.sensor.offset) / axis.sensor.scale
            count = axis.sensor.resolution or 1e-5
            own[axis.name] = Series(stamps, stamps, np.round(reading / count) * count)
        found.append(own)
    return found[0], found[1]


def recordings(robot: Robot, seed: int, cells: tuple[str, ...]) -> tuple[Recorded, ...]:
    """In motion with efforts; the same with one cell, two cells."""
    generator = np.random.default_rng([seed, 8])
    motion = moved(robot, seed)
    at = np.ascontiguousarray(motion.stamp_ns[::2])
    layout = prepare(robot).layout
    efforts = {
        f"effort/{name}": Series(
            at,
            at,
            column[::2] + generator.normal(0.0, EFFORT_NOISE[robot.name], at.size),
        )
        for name, column in zip(layout.motors, motion.truth.motor_effort.T, strict=True)
    }
    found = [Recorded("motion", motion.motors, motion.joints, efforts)]
    references = dict(efforts)
    for k, cell in enumerate(cells):
        column = motion.truth.tension[::2, layout.elements.index(cell)]
        noise = generator.normal(0.0, CELL_NOISE, at.size)
        references = {**references, f"tension/{cell}": Series(at, at, column + noise)}
        name = f"{k + 1} cells"
        found.append(Recorded(name, motion.motors, motion.joints, references))
    return tuple(found)


def in_poses(robot: Robot) -> tuple[Recorded, Truth]:
    """At rest in one pose after the other, where a spring scale can be read, and on the ways."""
    joints = robot.joints
    here = np.array([joint.reference_angle for joint in joints])
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
    truth = simulate(robot, time, angles, motor_angle=motors, allow_slack=True)
    stamps = EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    read = _read(robot, stamps, truth.motor_angle, truth.joint_angle)
    return Recorded("poses", *read, {}), truth


def scale_read(
    robot: Robot,
    recorded: Recorded,
    truth: Truth,
    generator: np.random.Generator,
    rate: float = RATE,
) -> list[dict[str, float]]:
    """What a spring scale reads at the last element of every cable, in every pose."""
    gain = 1.0 + SCALE_GAIN * float(generator.standard_normal())
    layout = prepare(robot).layout
    ends = [cable.element_names[-1] for cable in robot.cables]
    columns = [layout.elements.index(end) for end in ends]
    found = []
    samples = samples_of(prepare(robot), recorded)
    for pose in rest_poses(robot, samples, recorded.name):
        at = round((pose.stamp_ns - EPOCH_NS) * 1e-9 * rate)
        errors = gain * (1.0 + SCALE_NOISE * generator.standard_normal(len(ends)))
        values = truth.tension[at, columns] * errors
        found.append(dict(zip(ends, values.tolist(), strict=True)))
    return found


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


def compared(model: Model, motion: Moved) -> Figures:
    """Estimates of another motion beside the truth."""
    found: Estimates = estimate(
        model, condition(model.robot, motion.motors, motion.joints), uncertainty=True
    )
    assert found.stddev is not None
    return _figures(model, motion, found.stamp_ns, found.values, found.stddev)


def live(model: Model, motion: Moved, recorded: Recorded) -> Figures:
    """The same of the estimator that hears the motors' efforts."""
    estimator = Estimator(model)
    motors = np.stack([one.value for one in motion.motors.values()], axis=1).tolist()
    joints = np.stack([one.value for one in motion.joints.values()], axis=1).tolist()
    names = [name.removeprefix("effort/") for name in recorded.references]
    efforts = np.stack([one.value for one in recorded.references.values()], axis=1).tolist()
    made = []
    for k, stamp in enumerate(motion.stamp_ns.tolist()):
        heard = dict(zip(names, efforts[k], strict=True))
        estimator.update(stamp, motors[k], joints[k], efforts=heard)
        made += estimator.estimates
    stamps = np.array([one.stamp_ns for one in made])
    values = np.stack([one.values for one in made])
    return _figures(model, motion, stamps, values, np.stack([one.stddev for one in made]))


def _figures(
    model: Model, motion: Moved, stamps: NDArray[np.int64], values: Vector, stddev: Vector
) -> Figures:
    late = stamps >= motion.stamp_ns[0] + round(START_S * 1e9)
    true = np.stack([np.interp(stamps, motion.stamp_ns, column)
                     for column in motion.truth.tension.T], axis=1)[late]  # fmt: skip
    elements = true.shape[1]
    values, stddev = values[late], stddev[late][:, :elements]
    error = np.abs(values[:, model.layout.tension] - true)
    ok = values[:, elements : 2 * elements] == 0.0
    off = error / np.maximum(stddev, 1e-12)
    return Figures(
        float(ok.mean()), float(np.mean(off <= 2.0)),
        float(np.median(stddev / np.maximum(true, 1e-6))),
        float(np.mean(ok & (off > 2.0))), float(np.mean(ok & (off > 5.0))),
        float(np.mean(error / np.maximum(true, 1.0))),
    )  # fmt: skip


def finger_course(seed: int, hold: bool) -> Iterator[tuple[str, Figures]]:
    """The steps for one true finger, in one of ``WAYS``."""
    text, source = file_text("finger", hold), str(ROOT / "config" / "robots" / "finger.yaml")
    truth, wrong = drawn(load_document(source)[0], seed)
    robot = build_robot(truth, "truth")
    kind, moving, rate, currents = WAYS[(7 * seed) % len(WAYS)]
    unit = "currents" if currents else "torques"
    words = f"{kind}, {moving} joints, {rate:g} Hz, {unit}; {', '.join(wrong)}"
    print(f"  {seed}: {words}", flush=True)
    motion = finger_moved(robot, seed, kind, moving, rate)
    other = finger_moved(robot, seed + 50_000, "random", 2, rate)
    here = finger_moved(robot, seed, "random", 0, rate)
    rest = Recorded("rest", here.motors, here.joints, {})
    generator = np.random.default_rng([seed, 9])
    reading = scale_read(robot, rest, here.truth, generator, rate)[0]
    now = steps.preloaded(steps.tared(steps.begin(text, source), rest), [reading])
    yield "tare, preloads", compared(now.model, other)
    before = foretold(now, "motion").ok
    now = steps.fitted(now, [with_efforts(robot, motion, currents, seed)])
    yield "+ efforts", compared(now.model, other)
    found = live(now.model, other, with_efforts(robot, other, currents, seed))
    yield "live", found
    after = judged(now.model, now.heard).ok
    print(f"    OK foretold {before:.1%}, of the file {after:.1%}, live {found.ok:.1%}")


def course(name: str, seed: int, hold: bool) -> Iterator[tuple[str, Figures]]:
    """The steps for one truth."""
    text = file_text(name, hold)
    document: Any = load_document(ROOT / "config" / "robots" / f"{name}.yaml")[0]
    document = {key: value for key, value in document.items() if key != "uncertainty"}
    truth, wrong = drawn(document, seed)
    robot = build_robot(truth, "truth")
    ends = [cable.element_names[-1] for cable in robot.cables]
    motion, *with_cells = recordings(robot, seed, tuple(ends[:2]))
    other = moved(robot, seed + 50_000)
    generator = np.random.default_rng([seed, 9])
    poses, truth_there = in_poses(robot)
    readings = scale_read(robot, poses, truth_there, generator)
    print(f"  {seed}: {', '.join(wrong)}", flush=True)
    source = str(ROOT / "config" / "robots" / f"{name}.yaml")
    now = steps.begin(text, source)
    yield "fresh", compared(now.model, other)
    now = steps.tared(now, poses)
    yield "tare, preloads", compared(steps.preloaded(now, readings[:1]).model, other)
    now = steps.preloaded(now, readings)
    yield "in three poses", compared(now.model, other)
    drums = {
        node.motors[0][0]: 2.0 * (node.radius + CALLIPER_NOISE * float(generator.standard_normal()))
        for cable in robot.cables
        for node in cable.nodes
        if isinstance(node, Winch)
    }
    now = steps.drums_measured(now, drums)
    yield "+ drums", compared(now.model, other)
    for what, recorded in (("+ efforts", motion), ("+ one cell", with_cells[0]),
                           ("+ two cells", with_cells[1])):  # fmt: skip
        yield what, compared(steps.fitted(now, [recorded]).model, other)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("robot", choices=("prototype", "wrist", "finger"))
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--hold", action="store_true", help="the file states that drums hold")
    arguments = parser.parse_args()
    rows: dict[str, list[Figures]] = {}
    for seed in range(arguments.first, arguments.first + arguments.draws):
        taken = (finger_course(seed, arguments.hold) if arguments.robot == "finger" else
                 course(arguments.robot, seed, arguments.hold))  # fmt: skip
        for what, figures in taken:
            rows.setdefault(what, []).append(figures)
            print(f"    {what}: " + ", ".join(f"{k} {v:.1%}" for k, v in
                                              figures._asdict().items()), flush=True)  # fmt: skip
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
