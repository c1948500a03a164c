"""Equation (44): rho comes back from recordings of the simulated rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import pi
from pathlib import Path as File

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.simulation.load import make_load
from cdrj_ros.simulation.sensors import (
    JOINT_ENCODER,
    LoadCells,
    read_cells,
    read_encoder,
    reading_times,
)
from cdrj_ros.simulation.truth import simulate
from examples.paper.propagation import (
    KnownTension,
    Path,
    RhoEstimate,
    identify_rho,
    path_of,
    propagate,
    with_rho,
)

PROTOTYPE = File(__file__).parents[2] / "config" / "robots" / "prototype.yaml"

# preloads [N] and the rho that the source found at them, upper and lower
FIRST = ((23.52, 6.66), (0.1114, 0.3920))
SECOND = ((36.85, 26.26), (0.1100, 0.1315))
Case = tuple[tuple[float, float], tuple[float, float]]
DURATION, RATE = 26.0, 250.0


@dataclass(frozen=True)
class Recording:
    """Readings of the rig's sensors; the model's rho is deliberately wrong."""

    model: Model
    path: Path
    tension: np.ndarray
    nodal_force: np.ndarray


@cache
def recording(case: Case) -> Recording:
    """The motion of ``simulate`` with the sensors of ``simulate``."""
    robot = load_robot(PROTOTYPE)
    joint = robot.joints[0]
    counts = replace(joint.sensor, resolution=2.0 * pi / JOINT_ENCODER.counts)
    robot = replace(robot, joints=(replace(joint, sensor=counts),))
    for cable, preload, rho in zip(robot.cables, *case, strict=True):
        robot = with_rho(robot, cable.name, rho)
        cables = [replace(c, preload=preload) if c.name == cable.name else c for c in robot.cables]
        robot = replace(robot, cables=tuple(cables))
    time = np.arange(round(DURATION * RATE) + 1) / RATE
    moving = np.maximum(time - 1.0, 0.0)
    share = np.minimum(moving * 0.1, 1.0)
    angle = np.radians(38.0) * share**2 * (3.0 - 2.0 * share) * np.sin(2.0 * pi * 0.1 * moving)
    speed = np.gradient(angle, time)
    torque = make_load("rolling").torque(angle, speed, np.gradient(speed, time))
    truth = simulate(robot, time, angle, torque, cells=8)

    generator, cells = np.random.default_rng(7), LoadCells()
    times = reading_times(0.0, DURATION, 0.5 * cells.rate)
    joint_angle = read_encoder(
        JOINT_ENCODER, times, time, np.reshape(truth.joint_angle, (time.size, -1))[:, 0]
    )
    for cable in robot.cables:
        robot = with_rho(robot, cable.name, 0.7)
    model = prepare(robot)
    stamps = 1 + np.round(times * 1e9).astype(np.int64)

    def read(values: np.ndarray) -> np.ndarray:
        return read_cells(values, time, times, cells.force_noise, cells.force_step, generator)

    return Recording(
        model,
        path_of(model, stamps, joint_angle[:, None]),
        read(truth.tension),
        read(truth.nodal_force),
    )


@cache
def identified(case: Case, cable: str, node: int = 3, element: int = 8) -> RhoEstimate:
    rig = recording(case)
    layout = rig.model.layout
    name, pulley = f"{cable}/{element}", f"{cable}/{node}"
    tension = rig.tension[:, layout.elements.index(name)]
    force = rig.nodal_force[:, layout.pulleys.index(pulley)]
    known = KnownTension(name, tension, LoadCells().force_noise)
    return identify_rho(rig.model, rig.path, known, pulley, force)


@pytest.mark.parametrize("case", [FIRST, SECOND], ids=["first", "second"])
@pytest.mark.parametrize("cable", ["upper", "lower"])
def test_the_rho_of_the_source_are_recovered(case: Case, cable: str) -> None:
    true = case[1][("upper", "lower").index(cable)]
    found = identified(case, cable)
    assert found.rho == pytest.approx(true, abs=0.01)
    assert 0.0 < found.stddev < 0.001, "due to the load cells' noise alone"
    assert found.rms < 0.2, "the rest is the propagated noise of the load cells"
    assert found.residual == pytest.approx(found.samples * found.rms**2)


def test_without_noise_rho_comes_back_exactly_from_forces_made_with_it() -> None:
    rig = recording(SECOND)
    known = KnownTension("lower/8", rig.tension[:, 15], 0.02)
    made = propagate(prepare(with_rho(rig.model.robot, "lower", 0.234)), rig.path, [known])
    force = made.nodal_force[:, made.pulleys.index("lower/3")]
    found = identify_rho(rig.model, rig.path, known, "lower/3", force)
    assert found.rho == pytest.approx(0.234, abs=1e-4)
    assert found.rms < 1e-3


def test_data_that_do_not_determine_rho_are_refused() -> None:
    rig = recording(FIRST)
    known = KnownTension("upper/8", rig.tension[:, 7], 0.02)
    force = rig.nodal_force[:, 1]
    with pytest.raises(UsageError, match="the cable of upper/8 has no pulley lower/3; it has"):
        identify_rho(rig.model, rig.path, known, "lower/3", force)
    with pytest.raises(UsageError, match=r"must rise within \[0, 1\], got \(0.5, 0.2\)"):
        identify_rho(rig.model, rig.path, known, "upper/3", force, (0.5, 0.2))
    with pytest.raises(UsageError, match="has 3 readings for"):
        identify_rho(rig.model, rig.path, known, "upper/3", force[:3])
    still = rig.path.stamp_ns[:50]
    path = path_of(rig.model, still, np.zeros((50, 1)))
    resting = KnownTension("upper/8", rig.tension[:50, 7], 0.02)
    with pytest.raises(UsageError, match="slide together in 0 samples; at least 20 are needed"):
        identify_rho(rig.model, path, resting, "upper/3", force[:50])
