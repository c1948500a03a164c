"""Compiled kernels agree with the same kernels interpreted by Python.

Views into the flat vectors have two implementations: NumPy's, and addresses inside kernels.  When
interpreted, all are NumPy's, with bounds checked.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.description import LAWS
from cdrj_ros.robot.reader import load_robot

ROBOTS = sorted((Path(__file__).parents[2] / "config" / "robots").glob("*.yaml"))
SAMPLES = 8


def results() -> dict[str, np.ndarray]:
    """States, estimates and shapes of every robot with every law, in a motion with a reversal."""
    found = {}
    for path in ROBOTS:
        robot = load_robot(path)
        for law in LAWS:
            cables = tuple(replace(cable, law=law) for cable in robot.cables)
            model = prepare(replace(robot, cables=cables), check_range=False)
            generator = np.random.default_rng(7)
            reference = np.array([joint.reference_angle for joint in robot.joints])
            width = np.array([joint.upper - joint.lower for joint in robot.joints])
            inward = np.array([joint.lower + joint.upper for joint in robot.joints]) / 2 - reference
            way = np.where(inward >= 0.0, 1.0, -1.0) * 1e-2 * width
            motors = np.array([motor.reference_angle for motor in robot.motors])
            state, rows, stamp = initial_state(model), [], 1_000_000_000
            for k in range(SAMPLES):
                turn = min(k, SAMPLES - k) / SAMPLES  # with one reversal
                stamp += int(generator.integers(1, 9)) * 1_000_000
                sample = Sample(
                    stamp,
                    motors + 0.05 * turn * generator.standard_normal(motors.size),
                    reference + way * turn,
                )
                state, estimate = step(model, state, sample)
                rows.append(np.concatenate([state.values, estimate.values]))
            shape = shape_at(model, reference + way)
            found[f"{path.stem} {law}"] = np.array(rows)
            found[f"{path.stem} {law} shape"] = np.concatenate(
                [shape.length, shape.lever_arm.ravel(), shape.wrap, shape.direction.ravel()]
            )
    return found


def test_compiled_kernels_give_what_their_python_gives(tmp_path: Path) -> None:
    file = tmp_path / "interpreted.npz"
    done = subprocess.run(
        [sys.executable, __file__, str(file)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    compiled = results()
    with np.load(file) as interpreted:
        assert set(interpreted.files) == set(compiled)
        for name, values in compiled.items():
            scale = np.maximum(np.abs(values).max(axis=0), 1e-9)
            assert np.abs(interpreted[name] - values).max() <= np.max(1e-12 * scale), name
            assert np.isfinite(values).all(), name


if __name__ == "__main__":
    np.savez(sys.argv[1], **results())
