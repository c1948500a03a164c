"""Time of an update with positions, and of MuJoCo's evaluation of a model in space."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from bench.figures import ROBOT, Row, compared, in_turn
from bench.mjcf import mjcf
from bench.update import evaluating, poses_of, recorded_motion, stepping
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.model.prepared import Model, load_model, prepare
from cdrj_ros.robot.imported import robot_text
from cdrj_ros.robot.mjcf import read_mjcf
from cdrj_ros.robot.reader import parse_robot

Poses = list[NDArray[np.float64]]

PLANAR = ROBOT.with_name("prototype_positions.yaml")
STEPS = 5_000
ROUNDS = 9
HEIGHT = 0.004
"""Distance from the plane of the sites between MuJoCo's pulleys [m]."""


def imported(text: str) -> Model:
    """Model of the robot that `import_robot` makes of an MJCF."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "model.xml")
        path.write_text(text, encoding="utf-8")
        found = read_mjcf(path)
    return prepare(parse_robot(robot_text(found.document, found.remarks, "")), check_range=False)


def beside_mujoco(stamp_ns: NDArray[np.int64], poses: Poses) -> Row:
    """One update of cables in space beside MuJoCo's evaluation of the model they come from."""
    text = mjcf(load_model(str(ROBOT)).robot, HEIGHT)
    model = imported(text)
    # tendons without actuators are cables without motors
    motion = Samples(stamp_ns[: len(poses)], np.empty((len(poses), 0)), np.array(poses))
    ours, theirs = (
        np.array(times) * 1e6 / STEPS
        for times in in_turn(ROUNDS, stepping(model, motion, STEPS), evaluating(text, poses))
    )
    return compared(
        "one update, 2 imported tendons, 14 cylinders, 12 eyelets in space", "µs",
        ours, "MuJoCo: the same tendons, no friction", theirs, "≤ 2",
    )  # fmt: skip


def measure() -> list[Row]:
    """Microseconds per sample: tables, positions, MuJoCo's model."""
    models = load_model(str(ROBOT)), load_model(str(PLANAR))
    recorded = recorded_motion(models[0])
    joint = models[1].robot.joints[0]
    motion = Samples(
        recorded.stamp_ns,
        recorded.motor_angle,
        np.clip(recorded.joint_angle, joint.lower, joint.upper),
    )
    tables, positions = (
        np.array(times) * 1e6 / STEPS
        for times in in_turn(ROUNDS, *(stepping(model, motion, STEPS) for model in models))
    )
    return [
        compared(
            "one update, prototype by positions", "µs", positions,
            "the prototype by tables", tables,
        ),
        beside_mujoco(recorded.stamp_ns, poses_of(motion, STEPS)),
    ]  # fmt: skip
