"""Compilation of all numerical kernels ahead of use.

A build runs ``python -m cdrj_ros.commands.compile_ahead --missing``, so that no start has to
compile.  The machine code is specific to the processor of the building machine, usually the
robot's, and faster than generic code.  On another processor the first start compiles the kernels,
as it does after the installation of a wheel.
"""

from __future__ import annotations

import argparse
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from time import monotonic
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.commands.compilation import compile_together
from cdrj_ros.commands.parts import IN_SPACE, INDEPENDENT, OF_EVERY_START, is_compiled
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.messages import estimate_encoder
from cdrj_ros.model.cable import compile_solve_cable
from cdrj_ros.model.compiled import direct
from cdrj_ros.model.friction import blended_loss
from cdrj_ros.model.linked import compile_without_callees
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.mechanism import advance
from cdrj_ros.model.prepared import Model, read_only
from cdrj_ros.model.shape import shape
from cdrj_ros.model.spatial_shape import shape_in_space

ROBOT: Final = "prototype"
"""Kernels are the same for every robot; this one is installed with the package."""


def _samples(model: Model) -> Samples:
    """Two samples in the reference pose."""
    robot = model.robot
    motor = np.array([[motor.reference_angle for motor in robot.motors]] * 2)
    joint = np.array([[joint.reference_angle for joint in robot.joints]] * 2)
    return Samples(np.array([1_000_000_000, 1_001_000_000]), motor, joint)


def _compile_step() -> None:
    """Compile the step, without the geometry and the solution of a cable, which it calls."""
    compile_without_callees()
    vector = np.empty(0)
    direct(advance, _plan(), read_only(vector), *3 * (vector,), 0.0, vector)


def _compile_geometry() -> None:
    """Compile geometry and solution of cables in a plane, and what encodes estimates."""
    numbers = read_only(np.empty(0))
    direct(shape, _plan(), numbers, *3 * (np.empty(0),))
    compile_solve_cable()
    blended_loss(0.5, 0.1, 0.1, 1.0, 0.0, 0)
    estimate_encoder.find_entry()


def _compile_space() -> None:
    """Compile the geometry of cables in space."""
    direct(shape_in_space, _plan(), read_only(np.empty(0)), *3 * (np.empty(0),))


def _plan() -> NDArray[np.int64]:
    plan = np.empty(0, dtype=np.int64)
    plan.flags.writeable = False
    return plan


def _compile_recordings() -> None:
    """Compile the kernels of whole recordings, and use those of every start once."""
    model = load_model(ROBOT)
    samples = _samples(model)
    LiveEstimator(model).take(samples.at(0))
    run(model, initial_state(model), samples)


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


PARTS: Final[Mapping[str, Callable[[], None]]] = {
    "step": _compile_step,
    "geometry": _compile_geometry,
    IN_SPACE: _compile_space,
    "recordings": _compile_recordings,
    "rig": _compile_rig,
}
"""What compiles each part of ``parts.OUTERMOST``."""


def compile_kernels(parts: Iterable[str]) -> bool:
    """Compile and store the kernels of some parts; False if one failed."""
    first = [part for part in parts if part in INDEPENDENT]
    others = [part for part in parts if part not in INDEPENDENT]
    return compile_together(first) and compile_together(others)


def compile_part(part: str) -> None:
    """Compile a part in this process, which ends with the process that holds its standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # that process decides when to stop
    threading.Thread(target=_end_with_the_parent, name="parent", daemon=True).start()
    gc.set_threshold(100_000, 50, 100)  # little is garbage; saves 6 % of the time
    PARTS[part]()


def _end_with_the_parent() -> None:
    """Wait until nobody holds the other end of standard input any more."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


def main() -> int:
    """Compile all parts or those of every start, or what of them is not on disk."""
    parser = argparse.ArgumentParser(prog="compile_ahead", description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--missing",
        action="store_true",
        help="only what is not on disk, compiled from these sources",
    )
    parser.add_argument(
        "--start", action="store_true", help="only what every start of the estimator needs"
    )
    arguments = parser.parse_args()
    begin = monotonic()
    parts = OF_EVERY_START if arguments.start else PARTS
    if not compile_kernels(
        [part for part in parts if not (arguments.missing and is_compiled(part))]
    ):
        return 1
    print(f"kernels compiled in {monotonic() - begin:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
