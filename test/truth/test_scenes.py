"""Laws of whole scenes: what the truth must say of any robot."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from truth import robots
from truth.scenes import Scene, waves


def periodic(scene: Scene, mu: float) -> Scene:
    """Two cycles of 4 s, and one coefficient of friction everywhere."""
    time = np.arange(1601) / 200.0
    joint = np.stack(
        [waves(time, (0.3, 0.25, 0.7 * j), (0.1, 0.5, 0.3)) for j in range(len(scene.joints))], 1
    ) * np.ptp(scene.joint, axis=0)
    pull = {
        motor: waves(time, (0.0005, 0.25 + 0.25 * (k % 2), 1.0 * k))
        for k, motor in enumerate(scene.motors)
    }
    lines = tuple(
        replace(line, nodes=tuple(replace(node, mu=mu) for node in line.nodes))
        for line in scene.lines
    )
    return replace(scene, time=time, joint=joint, pull=pull, lines=lines)


def work(scene: Scene) -> tuple[float, float]:
    """Work of the cables on joints and motors in the second cycle, and its size without sign."""
    truth, second = scene.truth(), slice(800, None)
    effort = np.hstack([truth.joint_effort, truth.motor_effort])[second]
    moved = np.diff(np.hstack([scene.joint, scene.motor])[second], axis=0)
    power = 0.5 * (effort[1:] + effort[:-1]) * moved
    return float(power.sum()), float(np.abs(power).sum())


SHORT = [robots.skew_cylinders(1.0, 100), robots.sphere(1.0, 100), robots.sheath(seconds=1.0)]


@pytest.mark.parametrize("scene", SHORT, ids=lambda scene: scene.name)
def test_without_friction_the_cables_give_back_all_work(scene: Scene) -> None:
    done, size = work(periodic(scene, 0.0))
    assert abs(done) < 5e-4 * size


@pytest.mark.parametrize("scene", SHORT, ids=lambda scene: scene.name)
def test_the_work_that_is_lost_is_what_the_slipping_cells_take(scene: Scene) -> None:
    # the efforts are pulls of spans on bodies, friction is that of cells: they meet only in energy
    scene = periodic(scene, 0.2)
    done, _ = work(scene)
    taken = 0.0
    for c in range(len(scene.lines)):
        for one, two in pairwise(list(scene.states(c)[1])[800:]):
            stretch = 1.0 + 0.5 * (two.strain[1:] + two.strain[:-1])
            held = np.concatenate(
                [0.5 * (_before(a, b) + b.friction)
                 for a, b in zip(one.cells, two.cells, strict=True) if b is not None]
                or [np.empty(0)]
            )  # fmt: skip
            taken += np.sum(held * two.slip * stretch)
    assert taken > 0.0
    assert -done == pytest.approx(taken, rel=0.02)


def _before(a, b):
    """Friction of cells b in the state before, 0 where they are new."""
    held = np.zeros(b.index.size)
    if a is not None:
        _, mine, his = np.intersect1d(b.index, a.index, return_indices=True)
        held[mine] = a.friction[his]
    return held
