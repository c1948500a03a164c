"""The estimator beside the truth.

The estimator lets the friction of an arc act in the middles of a few cells that move along with it;
many cells leave next to nothing of the difference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Node, Pulley, Robot
from truth import robots
from truth.scenes import Scene, Truth


@dataclass(frozen=True)
class Errors:
    """Errors of the estimate against the truth, after the first cycle."""

    mean: float
    """Mean relative error of all tensions [-]."""
    largest: float
    """Largest error of a tension [N]."""
    joint_effort: float
    """Root mean square error of the joint efforts over their root mean square, the worst [-]."""
    motor_effort: float


@cache
def known(name: str) -> tuple[Scene, Truth]:
    scene: Scene = getattr(robots, name)()
    return scene, scene.truth()


def divided(robot: Robot, cells: int) -> Robot:
    """The robot with so many contact cells on every body."""

    def node(one: Node) -> Node:
        assert one.place is not None
        if not isinstance(one, Pulley) or one.place.kind == "point":
            return one
        return replace(one, cells=cells)

    return replace(
        robot, cables=tuple(replace(c, nodes=tuple(map(node, c.nodes))) for c in robot.cables)
    )


def errors(scene: Scene, truth: Truth, cells: int) -> Errors:
    """Estimate from the exact angles; ``cells`` of every body, 0: as many as usual."""
    model = prepare(divided(scene.robot, cells))
    stamps = 1_000_000_000 + np.round(scene.time * 1e9).astype(np.int64)
    samples = Samples(stamps, scene.motor.copy(), scene.joint.copy())
    estimates = run(model, initial_state(model), samples)[1]
    after = scene.time >= scene.cycle
    layout, values = estimates.layout, estimates.values[after]
    tension = truth.tension[after]
    error = np.abs(values[:, layout.tension] - tension)
    efforts = []
    for part, true in (
        (layout.joint_effort, truth.joint_effort[after]),
        (layout.motor_effort, truth.motor_effort[after]),
    ):
        size = np.sqrt(np.mean(true**2, axis=0))
        off = np.sqrt(np.mean((values[:, part] - true) ** 2, axis=0))
        efforts.append(float(np.max(off / np.maximum(size, 1e-6))))
    return Errors(float(np.mean(error / tension)), float(error.max()), *efforts)


@pytest.mark.parametrize("name", ["skew_cylinders", "sphere", "carriage", "platform", "sheath"])
def test_tensions_and_efforts_are_those_of_cells_on_the_surfaces(name: str) -> None:
    usual, many = (errors(*known(name), cells) for cells in (0, 12))
    assert usual.mean <= 0.001
    assert usual.joint_effort <= 0.005
    assert usual.motor_effort <= 0.005
    assert many.mean <= 0.0002
    assert many.largest <= 0.05
    assert many.joint_effort <= 0.001
    assert many.motor_effort <= 0.001
