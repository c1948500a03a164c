"""The kernel of cables in space is compiled and loaded only where a robot needs it."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from support.warm import Ended, Programs

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, shape_at

ROOT = Path(__file__).parents[2]

# lengths in the reference pose, whether both kernels are on disk, and loaded and compiled ones
LENGTHS = """
import numpy as np
from cdrj_ros.model.compiled import kernels_are_compiled
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import shape_at
from cdrj_ros.model.shape import shape
from cdrj_ros.model.spatial_shape import shape_in_space

model = load_model("{robot}")
reference = np.array([joint.reference_angle for joint in model.robot.joints])
print(shape_at(model, reference).length.tobytes().hex())
for kernel in (shape, shape_in_space):
    counts = kernel.stats.cache_hits, kernel.stats.cache_misses
    print(kernels_are_compiled(kernel), *(sum(count.values()) for count in counts))
"""


def lengths(warm: Programs, kernels: Path, robot: str) -> list[str]:
    """Lines of ``LENGTHS`` of a process that keeps its kernels in a folder."""
    done: Ended = warm.run(
        ROOT, LENGTHS.format(robot=robot), {**os.environ, "NUMBA_CACHE_DIR": str(kernels)}
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def reference(model: Model) -> np.ndarray:
    """Reference pose [rad] or [m], shape (joints,)."""
    return np.array([joint.reference_angle for joint in model.robot.joints])


def test_only_robots_in_space_compile_its_kernel(warm: Programs, tmp_path: Path) -> None:
    lengths_of_plane = lengths(warm, tmp_path, "hoist")
    assert lengths_of_plane[1:] == ["True 0 1", "False 0 0"]

    found = lengths(warm, tmp_path, "finger3d")
    assert found[1:] == ["True 1 0", "True 0 1"], "the other kernel is as it was"
    model = load_model("finger3d")
    assert found[0] == shape_at(model, reference(model)).length.tobytes().hex()

    again = lengths(warm, tmp_path, "finger3d")
    assert again == [found[0], "True 1 0", "True 1 0"], "now it is loaded"
    assert lengths(warm, tmp_path, "hoist") == [lengths_of_plane[0], "True 1 0", "True 0 0"]


@pytest.mark.parametrize("robot", ["cdpr", "finger3d"])
def test_an_unpickled_robot_needs_no_preparation(robot: str) -> None:
    model = load_model(robot)
    start, begin = reference(model), initial_state(model)
    motor = np.array([motor.reference_angle for motor in model.robot.motors])
    sample = Sample(1_000_000_000, motor, start)
    with ProcessPoolExecutor(1, get_context("spawn")) as processes:
        _, estimate = processes.submit(step, model, begin, sample).result()
        found = processes.submit(shape_at, model, start).result()
    assert estimate.values.tobytes() == step(model, begin, sample)[1].values.tobytes()
    assert found.length.tobytes() == shape_at(model, start).length.tobytes()
