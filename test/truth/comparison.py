"""The estimator beside the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from cdrj_ros.estimation.estimator import Estimates, Samples, initial_state, run
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import build_robot
from truth.scenes import Scene, Truth


@dataclass(frozen=True)
class Comparison:
    """Errors of the estimate against the truth, after the first cycle."""

    mean: float
    """Mean relative error of all tensions [-]."""
    largest: float
    """Largest error of a tension [N]."""
    joint_effort: float
    """Root mean square error of the joint efforts over their root mean square, the worst [-]."""
    motor_effort: float


def estimate(scene: Scene, cells: int = 0) -> Estimates:
    """The estimator's result for the scene's exact angles.

    Args:
        scene: the robot and its motion.
        cells: contact cells of every body; 0 leaves their number to the estimator.
    """
    model = prepare(build_robot(yaml.safe_load(scene.robot_file(cells)), Path(scene.name)))
    stamps = 1_000_000_000 + np.round(scene.time * 1e9).astype(np.int64)
    samples = Samples(stamps, scene.motor.copy(), scene.joint.copy())
    return run(model, initial_state(model), samples)[1]


def compare(scene: Scene, truth: Truth, cells: int = 0) -> Comparison:
    """Errors of the estimate against the truth."""
    known = scene.time >= scene.cycle
    estimates = estimate(scene, cells)
    layout, values = estimates.layout, estimates.values[known]
    tension = truth.tension[known]
    error = np.abs(values[:, layout.tension] - tension)
    efforts = []
    pairs = (
        (layout.joint_effort, truth.joint_effort), (layout.motor_effort, truth.motor_effort),
    )  # fmt: skip
    for part, true in pairs:
        size = np.sqrt(np.mean(true[known] ** 2, axis=0))
        off = np.sqrt(np.mean((values[:, part] - true[known]) ** 2, axis=0))
        efforts.append(float(np.max(off / np.maximum(size, 1e-6))))
    return Comparison(float(np.mean(error / tension)), float(error.max()), *efforts)
