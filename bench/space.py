"""Time of an update of the prototype with positions in the plane and in space."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bench.figures import ROBOT, Row, compared, in_turn
from bench.update import recorded_motion, stepping
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.reader import parse_robot

PLANAR = ROBOT.with_name("prototype_positions.yaml")
STEPS = 5_000
ROUNDS = 9


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


def measure() -> list[Row]:
    """Microseconds per sample, one by one: tables, positions in the plane, positions in space."""
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
    ]  # fmt: skip
