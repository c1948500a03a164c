"""Compilation of all numerical kernels ahead of use.

A build ends with ``python -m cdrj_ros.commands.compile_ahead``, so that no start has to compile.
The machine code is specific to the processor of the building machine, usually the robot's, and
faster than generic code.  On another processor the first start compiles the kernels, as it does
after the installation of a wheel.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from time import monotonic
from typing import Final

import numpy as np

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.conditioning.tracking import new_track, track, track_all
from cdrj_ros.estimation.ensemble import Spread
from cdrj_ros.estimation.estimator import initial_state, run, step
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.estimation.slipping_drums import run_slipping
from cdrj_ros.estimation.unsure import mark_recording, preload_of_elements
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.reader import build_robot

ROBOT: Final = "prototype"
"""Kernels are the same for every robot; this one is installed with the package."""


def _samples(model: Model) -> Samples:
    """Two samples in the reference pose."""
    robot = model.robot
    motor = np.array([[motor.reference_angle for motor in robot.motors]] * 2)
    joint = np.array([[joint.reference_angle for joint in robot.joints]] * 2)
    return Samples(np.array([1_000_000_000, 1_001_000_000]), motor, joint)


def _compile_step() -> None:
    """Compile the kernels of every start, which the other parts use too."""
    model = load_model(ROBOT)
    samples = _samples(model)
    step(model, initial_state(model), samples.at(0))
    track(new_track(), 1_000_000, 0.0, 1.0, 1.0, False)


def _compile_deviations() -> None:
    """Compile the kernels of standard deviations, live and of recordings."""
    model = load_model(ROBOT)
    samples = _samples(model)
    live = LiveEstimator(model)
    live.take(samples.at(0))
    Spread(model).run(initial_state(model), samples)


def _compile_recordings() -> None:
    """Compile the kernels of whole recordings."""
    model = load_model(ROBOT)
    samples = _samples(model)
    _, estimates = run(model, initial_state(model), samples)
    run_slipping(model, initial_state(model), samples)
    preload = preload_of_elements(model.robot)
    mark_recording(estimates.values, preload, np.empty((0, 0)), 1.0, np.ones(2, dtype=np.bool_))
    track_all(samples.stamp_ns, np.zeros(2), 1.0, 1.0, False, np.zeros(2))


def _compile_motor_alone() -> None:
    """Compile the kernels of joints without encoder."""
    from cdrj_ros.estimation.motor_alone import MotorAlone

    document = deepcopy(dict(load_model(ROBOT).robot.document))
    for joint in document["joints"]:
        joint["measured"] = False
    model = prepare(build_robot(document, ROBOT))
    samples = replace(_samples(model), joint_angle=np.empty((2, 0)))
    MotorAlone(model, members=2).run(samples, np.full((2, len(model.robot.motors)), np.nan))


def _compile_rig() -> None:
    """Compile the kernels of the simulated rig: live, following, and balanced by its motors."""
    from cdrj_ros.rig.follow import follow_joints
    from cdrj_ros.rig.live import LiveRig, LiveSettings
    from cdrj_ros.rig.prescribed import follow
    from cdrj_ros.rig.truth import simulate

    model = load_model(ROBOT)
    robot, joints, time = model.robot, _samples(model).joint_angle, np.array([0.0, 1e-3])
    rig = LiveRig(robot, LiveSettings(cells=2))
    rig.step(rig.motor_angle)
    follow_joints(model, joints)
    follow(robot, time, joints, cells=2)
    simulate(robot, time, joints[:, 0], np.zeros(2), cells=2)


PARTS: Final[dict[str, Callable[[], None]]] = {
    "step": _compile_step,
    "deviations": _compile_deviations,
    "recordings": _compile_recordings,
    "motor_alone": _compile_motor_alone,
    "rig": _compile_rig,
}
"""Parts that are compiled in one process each; the first alone, then the others in parallel."""


def compile_kernels() -> bool:
    """Compile and store every kernel of estimation and simulation; False if one failed."""
    first, *others = PARTS
    if _run(first).wait() != 0:
        return False
    together = [_run(name) for name in others]
    codes = [process.wait() for process in together]
    return not any(codes)


def _run(part: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "cdrj_ros.commands.compile_ahead", part])


def main(arguments: list[str]) -> int:
    """Compile the named parts in this process, or all of them in several."""
    if arguments:
        for name in arguments:
            PARTS[name]()
        return 0
    begin = monotonic()
    if not compile_kernels():
        return 1
    print(f"kernels compiled in {monotonic() - begin:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
