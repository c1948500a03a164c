"""One update of the prototype from Python, compared with MuJoCo."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bench.figures import BAG, ROBOT, Row, compared, in_turn
from bench.mjcf import mjcf
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Sample, Samples, initial_state, run, step
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.recordings.recording import Topics

STEPS = 10_000
ROUNDS = 15
BULK = 4
"""Ratio of the number of steps in bulk runs to that in step-by-step runs."""


def recorded_motion(model: Model) -> Samples:
    """The sample recording's encoder readings, on the estimator's time line."""
    return condition_recording(model, read_inputs(str(BAG), Topics(), model)).segments[0]


def stepping(
    model: Model, motion: Samples, count: int, ensemble: Ensemble | None = None
) -> Callable[[], None]:
    """``step`` over the first samples, one call each, or the ensemble's."""
    readings = [
        Sample(int(stamp), motor, joint)
        for stamp, motor, joint in zip(
            motion.stamp_ns[:count],
            motion.motor_angle[:count],
            motion.joint_angle[:count],
            strict=True,
        )
    ]

    def stepped() -> None:
        state = initial_state(model)
        for sample in readings:
            state, _ = step(model, state, sample)

    def stepped_with_spread() -> None:
        assert ensemble is not None
        ensemble.reset()
        state = initial_state(model)
        for sample in readings:
            state, *_ = ensemble.step(state, sample)

    return stepped if ensemble is None else stepped_with_spread


def in_bulk(model: Model, motion: Samples, ensemble: Ensemble) -> Callable[[], None]:
    """Run all samples in one call, with standard deviations."""

    def ran() -> None:
        ensemble.reset()
        ensemble.run(initial_state(model), motion)

    return ran


def poses_of(motion: Samples, count: int) -> list[NDArray[np.float64]]:
    """``qpos`` of the prototype's MJCF, at the first samples."""
    angles = motion.joint_angle[:count, 0]
    drum = 0.015 * motion.motor_angle[:count, 0]
    return list(np.stack([drum, angles, angles], axis=1))


def evaluating(text: str, poses: list[NDArray[np.float64]]) -> Callable[[], None]:
    """Lengths and Jacobians of a model's tendons by MuJoCo in given poses, without friction."""
    import mujoco  # type: ignore[import-untyped,unused-ignore]

    mechanism = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(mechanism)
    kinematics, com_pos, tendon = mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon

    def evaluated() -> None:
        qpos = data.qpos
        for pose in poses:
            qpos[:] = pose
            kinematics(mechanism, data)
            com_pos(mechanism, data)
            tendon(mechanism, data)

    return evaluated


def measure() -> list[Row]:
    """Time per sample [µs]: step by step beside MuJoCo, in bulk, and both with deviations."""
    model = load_model(str(ROBOT))
    motion = recorded_motion(model)
    many = motion.part(slice(0, BULK * STEPS))
    theirs, ours, sure, bulk, sure_bulk = (
        np.array(times) * 1e6
        for times in in_turn(
            ROUNDS,
            evaluating(mjcf(model.robot), poses_of(motion, STEPS)),
            stepping(model, motion, STEPS),
            stepping(model, motion, STEPS, Ensemble(model)),
            lambda: run(model, initial_state(model), many),
            in_bulk(model, many, Ensemble(model)),
        )
    )
    beside = "MuJoCo: two tendons, no friction"
    what = "one update, 2 cables, 14 pulleys, every output"
    return [
        compared(what, "µs", ours / STEPS, beside, theirs / STEPS, "≤ 0.5"),
        compared(
            "one update with its standard deviations", "µs", sure / STEPS, beside, theirs / STEPS,
            "≤ 0.75",
        ),
        compared(
            "in bulk with standard deviations", "µs", sure_bulk / (BULK * STEPS),
            "in bulk without", bulk / (BULK * STEPS),
        ),
    ]  # fmt: skip
