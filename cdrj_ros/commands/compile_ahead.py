"""Compilation of all numerical kernels ahead of use.

A build ends with ``python -m cdrj_ros.commands.compile_ahead``, so that no start has to compile.
The machine code is specific to the processor of the building machine, usually the robot's, and
faster than generic code.  On another processor the first start compiles the kernels, as it does
after the installation of a wheel.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from time import monotonic
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.commands.compilation import OF_EVERY_START, compile_together
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.conditioning.tracking import new_track, track, track_all
from cdrj_ros.estimation.ensemble import Spread, find_kernels
from cdrj_ros.estimation.estimator import find_entry, initial_state, run
from cdrj_ros.estimation.member_records import no_members
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.estimation.slipping_drums import run_slipping
from cdrj_ros.estimation.unsure import mark_recording, mark_unsure, preload_of_elements
from cdrj_ros.model.compiled import direct
from cdrj_ros.model.linked import compile_without_callees
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model, prepare, read_only
from cdrj_ros.model.shape import shape
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
    """Compile the step, without the geometry that it calls."""
    compile_without_callees()
    find_entry()


def _compile_geometry() -> None:
    """Compile the geometry of all cables, and small kernels of every start."""
    numbers = read_only(np.empty(0))
    direct(shape, _plan(), numbers, *4 * (np.empty(0),))
    track(new_track(), 1_000_000, 0.0, 1.0, 1.0, False)
    mark_unsure(np.zeros(1), np.zeros(0), np.zeros(0), 1.0)


def _compile_members() -> None:
    """Compile the kernels of live standard deviations, without the step that they call."""
    compile_without_callees()
    find_kernels(_plan(), read_only(np.empty(0)), no_members())


def _plan() -> NDArray[np.int64]:
    plan = np.empty(0, dtype=np.int64)
    plan.flags.writeable = False
    return plan


def _compile_live() -> None:
    """Use the kernels of every start once, and compile what is left of them."""
    model = load_model(ROBOT)
    LiveEstimator(model).take(_samples(model).at(0))


def _compile_recordings() -> None:
    """Compile the kernels of whole recordings."""
    model = load_model(ROBOT)
    samples = _samples(model)
    _, estimates = run(model, initial_state(model), samples)
    run_slipping(model, initial_state(model), samples)
    preload = preload_of_elements(model.robot)
    Spread(model).run(initial_state(model), samples)
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
    "geometry": _compile_geometry,
    "members": _compile_members,
    "live": _compile_live,
    "recordings": _compile_recordings,
    "motor_alone": _compile_motor_alone,
    "rig": _compile_rig,
}
"""Parts that are compiled in one process each: those of ``OF_EVERY_START`` first, at once, then
the others, which use them."""


def compile_kernels() -> bool:
    """Compile and store every kernel of estimation and simulation; False if one failed."""
    others = [part for part in PARTS if part not in OF_EVERY_START]
    return compile_together(OF_EVERY_START) and compile_together(others)


def compile_part(part: str) -> None:
    """Compile a part in this process, which ends with the process that holds its standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # that process decides when to stop
    threading.Thread(target=_end_with_the_parent, name="parent", daemon=True).start()
    if part != OF_EVERY_START[0]:
        os.nice(3)  # all wait for the longest part
    PARTS[part]()


def _end_with_the_parent() -> None:
    """Wait until nobody holds the other end of standard input any more."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


def main() -> int:
    """Compile all parts."""
    begin = monotonic()
    if not compile_kernels():
        return 1
    print(f"kernels compiled in {monotonic() - begin:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
