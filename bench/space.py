"""Time of an update with positions in the plane and in space, and of MuJoCo's evaluation."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from bench.figures import ROBOT, Row, compared, in_turn
from bench.mjcf import mjcf
from bench.update import evaluating, poses_of, recorded_motion, stepping
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.importing.mjcf import read_mjcf
from cdrj_ros.importing.writing import robot_text
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.reader import parse_robot

Poses = list[NDArray[np.float64]]

PLANAR = ROBOT.with_name("prototype_positions.yaml")
STEPS = 5_000
ROUNDS = 9
HEIGHT = 0.004
"""Distance from the plane of the sites between MuJoCo's pulleys [m]."""


def in_space(document: dict[str, Any]) -> dict[str, Any]:
    """The same robot with positions in space: z = 0, every axis normal to the plane."""

    def lifted(entry: dict[str, Any]) -> dict[str, Any]:
        return {
            key: [*value, 0] if key in ("position_mm", "origin_mm") else value
            for key, value in entry.items()
        }

    def node(entry: dict[str, Any]) -> dict[str, Any]:
        round_an_axis = {"axis": [0, 0, 1]} if "turn" in entry else {}
        return {**lifted(entry), **round_an_axis}

    frames = [{**lifted(frame), "axis": [0, 0, 1]} for frame in document["frames"]]
    for frame in frames:
        if frame["motion"] == "rolling":
            del frame["axis"]
    cables = [
        {**cable, "nodes": [node(entry) for entry in cable["nodes"]]}
        for cable in document["cables"]
    ]
    return {**document, "frames": frames, "cables": cables}


def spatial(path: Path) -> Model:
    """Model of a planar robot file after its conversion to positions in space."""
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    return prepare(parse_robot(yaml.safe_dump(in_space(document))))


def imported(text: str) -> Model:
    """Model of the robot that `import_robot` makes of an MJCF."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "model.xml")
        path.write_text(text, encoding="utf-8")
        found = read_mjcf(path)
    return prepare(parse_robot(robot_text(found.document, found.remarks, "")), check_range=False)


def motion_along(model: Model, stamp_ns: NDArray[np.int64], poses: Poses) -> Samples:
    """Samples in given poses, whose motors take up the changes of length."""
    lengths = np.array([shape_at(model, pose).length for pose in poses])
    ends = np.cumsum([0, *(len(cable.nodes) - 1 for cable in model.robot.cables)])[:-1]
    changes = np.add.reduceat(lengths - lengths[0], ends, axis=1)
    radii = [cable.nodes[0].radius for cable in model.robot.cables]
    return Samples(stamp_ns[: len(poses)], -changes / radii, np.array(poses))


def beside_mujoco(stamp_ns: NDArray[np.int64], poses: Poses) -> Row:
    """One update of cables in space beside MuJoCo's evaluation of the model they come from."""
    text = mjcf(load_model(str(ROBOT)).robot, HEIGHT)
    model = imported(text)
    motion = motion_along(model, stamp_ns, poses)
    ours, theirs = (
        np.array(times) * 1e6 / STEPS
        for times in in_turn(ROUNDS, stepping(model, motion, STEPS), evaluating(text, poses))
    )
    return compared(
        "space", "one update, 2 imported tendons, 14 cylinders, 12 eyelets in space", "µs",
        ours, "MuJoCo: the same tendons, no friction", theirs,
    )  # fmt: skip


def measure() -> list[Row]:
    """Microseconds per sample: tables, positions in the plane and in space, MuJoCo's model."""
    models = load_model(str(ROBOT)), load_model(str(PLANAR)), spatial(PLANAR)
    recorded = recorded_motion(models[0])
    joint = models[1].robot.joints[0]
    motion = Samples(
        recorded.stamp_ns,
        recorded.motor_angle,
        np.clip(recorded.joint_angle, joint.lower, joint.upper),
    )
    tables, plane, space = (
        np.array(times) * 1e6 / STEPS
        for times in in_turn(ROUNDS, *(stepping(model, motion, STEPS) for model in models))
    )
    return [
        compared(
            "space", "one update, prototype by positions in the plane", "µs",
            plane, "the prototype by tables", tables,
        ),
        compared(
            "space", "one update, the same fourteen pulleys in space", "µs",
            space, "positions in the plane", plane, "≤ 2",
        ),
        beside_mujoco(recorded.stamp_ns, poses_of(motion, STEPS)),
    ]  # fmt: skip
