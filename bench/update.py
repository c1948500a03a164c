"""One update of the prototype from Python, beside MuJoCo's and with its pulleys divided."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from bench.figures import BAG, ROBOT, compared, in_turn
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Samples, initial_state, run, step
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.robot.imported import robot_text
from cdrj_ros.robot.mjcf import read_mjcf
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.assembly import divide_contacts

MJCF = Path(__file__).with_name("prototype.xml")
"""Two frictionless tendons over pulleys of the same size."""
STEPS = 10_000
ROUNDS = 15
CELLS = (1, 7, 700)
"""Contact cells of every pulley, from 14 pulleys to 9,800."""
IN_MOTION = slice(4000, 4250)
DIVIDED_ROUNDS = 5


def recorded_motion(model):
    """The sample recording's encoder readings, on the estimator's time line."""
    return condition_recording(model, read_inputs(str(BAG), Topics(), model)).segments[0]


def stepping(model, motion, ensemble=None):
    """``step`` over the samples, one call each; that of an ensemble adds standard deviations."""
    readings = [motion.at(k) for k in range(motion.stamp_ns.size)]
    advance = partial(step, model) if ensemble is None else ensemble.step

    def stepped():
        if ensemble is not None:
            ensemble.reset()
        state = initial_state(model)
        for sample in readings:
            state, _ = advance(state, sample)

    return stepped


def imported():
    """The robot that `import_robot` makes of the MJCF."""
    found = read_mjcf(MJCF)
    return prepare(parse_robot(robot_text(found.document, found.remarks, "")), check_range=False)


def evaluating(poses):
    """Lengths and Jacobians of the MJCF's tendons by MuJoCo in given poses, without friction."""
    import mujoco  # type: ignore[import-untyped,unused-ignore]

    mechanism = mujoco.MjModel.from_xml_path(str(MJCF))
    data = mujoco.MjData(mechanism)
    kinematics, com_pos, tendon = mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon

    def evaluated():
        qpos = data.qpos
        for pose in poses:
            qpos[:] = pose
            kinematics(mechanism, data)
            com_pos(mechanism, data)
            tendon(mechanism, data)

    return evaluated


def _run_often(model, motion, times):
    for _ in range(times):
        run(model, initial_state(model), motion)


def divided(whole, motion):
    """Time per pulley and sample [ns] where pulleys are divided into contact cells."""
    models = [prepare(divide_contacts(whole.robot, cells)) for cells in CELLS]
    repeats = [max(1, 200 // cells) for cells in CELLS]
    runs = [partial(_run_often, model, motion, n) for model, n in zip(models, repeats, strict=True)]
    cost, names = [], []
    counts = [len(whole.layout.pulleys) * cells for cells in CELLS]
    taken = in_turn(DIVIDED_ROUNDS, *runs)
    for model, n, pulleys, times in zip(models, repeats, counts, taken, strict=True):
        cost.append(np.array(times) * 1e9 / (n * motion.stamp_ns.size * pulleys))
        found = run(model, initial_state(model), motion)[1]
        iterations = found.values[1:, model.layout.iterations].mean()
        names.append(f"{pulleys} pulleys, {iterations:.1f} iterations")
    return [
        compared(f"per pulley and sample, {name}", "ns", ours, names[0], cost[0], "flat")
        for name, ours in zip(names[1:], cost[1:], strict=True)
    ]


def measure():
    """Time per sample [µs] beside MuJoCo: alone, with deviations, and of MuJoCo's own tendons."""
    model = load_model(str(ROBOT))
    motion = recorded_motion(model).part(slice(0, STEPS))
    angles, drum = motion.joint_angle[:, 0], 0.015 * motion.motor_angle[:, 0]
    poses = np.stack([drum, angles, angles], axis=1)
    # tendons without actuators are cables without motors
    in_space = Samples(motion.stamp_ns, np.empty((STEPS, 0)), poses)
    theirs, *ours = (
        np.array(times) * 1e6 / STEPS
        for times in in_turn(
            ROUNDS,
            evaluating(poses),
            stepping(model, motion),
            stepping(model, motion, Ensemble(model)),
            stepping(imported(), in_space),
        )
    )
    said = (
        ("one update, 2 cables, 14 pulleys, every output", "≤ 0.5"),
        ("one update with its standard deviations", "≤ 0.75"),
        ("one update, the same tendons imported, 14 cylinders, 12 eyelets in space", "≤ 2"),
    )
    beside = "MuJoCo: two tendons, no friction"
    rows = [
        compared(what, "µs", mine, beside, theirs, aim)
        for (what, aim), mine in zip(said, ours, strict=True)
    ]
    return rows + divided(model, motion.part(IN_MOTION))
