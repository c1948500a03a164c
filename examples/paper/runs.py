"""The source's experiments on the simulated rig: readings of its sensors, truth and estimates.

The rig is made with the values of rho that the source identified on its own rig, cable by cable
and preload by preload.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.arrays import Series, Stamps, Table, Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import Layout
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Robot, Sensor
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.load import Load, make_load
from cdrj_ros.simulation.sensors import (
    JOINT_ENCODER,
    MOTOR_ENCODER,
    Encoder,
    LoadCells,
    counted,
    measured,
)
from cdrj_ros.simulation.truth import simulate

Forces = Mapping[str, Vector]
"""Forces [N], shape (n,), by channel: ``tension/cable/element``, ``nodal_force/cable/node`` or
``friction/cable/node``."""

CABLES: Final = ("upper", "lower")
"""The source's two cables, in its order."""

LOAD: Final = make_load("rolling")
"""The load of the rig."""

EPOCH_NS: Final = 1_000_000_000
"""Stamp of the start of a run [ns]."""


@dataclass(frozen=True)
class Experiment:
    """One set of preloads of the source, and the rho that it identified there by (44)."""

    name: str
    preload: tuple[float, float]
    """Of the upper and lower cable [N]."""
    rho: tuple[float, float]
    """Of the upper and lower cable [-]."""

    @property
    def label(self) -> str:
        """The preloads, for headings."""
        return "{:.2f} / {:.2f} N".format(*self.preload)


EXPERIMENTS: Final = (
    Experiment("first", (23.52, 6.66), (0.1114, 0.3920)),
    Experiment("second", (36.85, 26.26), (0.1100, 0.1315)),
)


@dataclass(frozen=True)
class Motion:
    """A sine of the joint about its middle; assumed, since the source does not give its motion."""

    amplitude: float = float(np.radians(38.0))
    """[rad]."""
    frequency: float = 0.1
    """[Hz]."""
    cycles: int = 2
    """Cycles that are evaluated, from upper limit to upper limit."""
    dwell: float = 1.0
    """Rest in the reference pose before [s]."""
    rate: float = 1000.0
    """Steps of the rig per second [Hz]; encoders are read no faster."""

    @property
    def period(self) -> float:
        """[s]."""
        return 1.0 / self.frequency

    @property
    def begin(self) -> float:
        """Time of the first evaluated cycle [s]: the first full upper limit."""
        return self.dwell + 1.25 * self.period

    def path(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Time [s], angle [rad], speed [rad/s] and acceleration [rad/s^2] of the joint.

        The amplitude grows over the first period.  The path is half a second longer than the
        cycles, because the joint waits at each reversal.
        """
        end = self.begin + self.cycles * self.period + 0.5
        time = np.arange(round(end * self.rate) + 1) / self.rate
        moving = np.maximum(time - self.dwell, 0.0)
        share = np.minimum(moving * self.frequency, 1.0)
        grown = share * share * (3.0 - 2.0 * share)
        angle = self.amplitude * grown * np.sin(2.0 * np.pi * self.frequency * moving)
        speed = np.gradient(angle, time)
        return time, angle, speed, np.gradient(speed, time)


@dataclass(frozen=True)
class Run:
    """Forces over the evaluated cycles, n samples from the first upper limit on."""

    time: Vector
    """From the first upper limit [s], shape (n,)."""
    angle: Vector
    """Of the joint [rad], shape (n,)."""
    turns: Vector
    """Times at which the joint turns, from an upper limit to an upper limit [s]."""
    true: Forces
    """What the rig does."""


@dataclass(frozen=True)
class Recording(Run):
    """A run at the times of the load cells' readings, with what the sensors read."""

    read: Forces
    """By the load cells."""
    begin: float
    """Time of the first upper limit, from the start [s]."""
    samples: Samples
    """Conditioned samples of the encoders, from the rest on."""


def with_friction(
    robot: Robot,
    preload: Sequence[float] | None = None,
    rho: Sequence[float] | None = None,
    **keys: float | str,
) -> Robot:
    """The robot with other preloads [N] and rho by cable, and other keys of ``friction``."""
    document: Any = deepcopy(robot.document)
    for k, cable in enumerate(document["cables"]):
        own = keys if rho is None else {**keys, "rho": rho[k]}
        cable["friction"] = {**cable.get("friction", {}), **own}
        if preload is not None:
            cable["preload"] = preload[k]
    return build_robot(document, robot.source)


def with_constant_wraps(robot: Robot) -> Robot:
    """The robot with every wrap held at the middle of its range, as (3) of the source assumes."""
    document: Any = deepcopy(robot.document)
    for node in (node for cable in document["cables"] for node in cable["nodes"]):
        if isinstance(node.get("wrap_angle"), dict):
            node["wrap_angle"] = float(np.mean(node["wrap_angle"]["value"]))
            node.pop("moving_end")
    return build_robot(document, robot.source)


def record(robot: Robot, motion: Motion, *, cells: int = 8, seed: int = 0) -> Recording:
    """Run an experiment on the rig: truth with contact cells, then encoders and load cells.

    Args:
        robot: robot with the preloads and the friction of the rig.
        motion: motion of the joint.
        cells: contact cells per pulley.
        seed: seed of the load cells' noise.
    """
    truth, turns = _moved(robot, motion, LOAD, cells)
    layout, end = prepare(robot).layout, float(truth.time[-1])

    def angles(encoder: Encoder, angle: Table) -> Series:
        times = _times(end, min(encoder.rate, motion.rate), encoder.phase)
        ideal = np.interp(times, truth.time, angle[:, 0])
        stamps = _stamps(times)
        return Series(stamps, stamps, counted(encoder, ideal, 0.0, Sensor()))

    conditioned = condition(
        robot,
        {layout.motors[0]: angles(MOTOR_ENCODER, truth.motor_angle)},
        {layout.joints[0]: angles(JOINT_ENCODER, truth.joint_angle)},
    )
    cell, generator = LoadCells(), np.random.default_rng(seed)
    times = _times(end, cell.rate)
    kept = (times >= turns[0]) & (times <= turns[-1])
    tables = [_at(times, truth.time, table) for table in (truth.tension, truth.nodal_force)]
    noisy = [measured(table, cell.noise, cell.step, generator) for table in tables]
    return Recording(
        times[kept] - turns[0],
        np.interp(times[kept], truth.time, truth.joint_angle[:, 0]),
        turns - turns[0],
        _forces(layout, *(table[kept] for table in tables)),
        _forces(layout, *(table[kept] for table in noisy)),
        float(turns[0]),
        conditioned.segments[0],
    )


def estimate(recording: Recording, robot: Robot) -> Forces:
    """Estimates at the times of a recording, with the preloads, rho and law of a robot."""
    model = prepare(robot)
    samples, layout = recording.samples, model.layout
    values = run(model, initial_state(model), samples)[1].values
    since = (samples.stamp_ns - EPOCH_NS).astype(np.float64) * 1e-9
    tables = [
        _at(recording.begin + recording.time, since, values[:, part])
        for part in (layout.tension, layout.magnitude)
    ]
    return _forces(layout, *tables)


def move_freely(robot: Robot, motion: Motion, load: Load = LOAD, lever: float = 1.0) -> Run:
    """The lumped model along a prescribed joint motion: the source's simulation.

    Args:
        robot: robot with its preloads and friction.
        motion: motion of the joint.
        load: its load.
        lever: share of the true lever arm at which the strands pull, 0.5 for (10) as printed.

    Raises:
        UsageError: a cable would have to push.
    """
    truth, turns = _moved(robot, motion, load, 1, lever)
    kept = (truth.time >= turns[0]) & (truth.time <= turns[-1])
    return Run(
        truth.time[kept] - turns[0],
        truth.joint_angle[kept, 0],
        turns - turns[0],
        _forces(prepare(robot).layout, truth.tension[kept], truth.nodal_force[kept]),
    )


def _moved(
    robot: Robot, motion: Motion, load: Load, cells: int, lever: float = 1.0
) -> tuple[Truth, Vector]:
    """The rig along a motion, and the times at which its joint turned [s].

    It turns a little later than prescribed, since it waits at reversals.

    Raises:
        UsageError: it did not reach a limit.
    """
    time, angle, speed, acceleration = motion.path()
    torque = load.torque(angle, speed, acceleration) / lever
    truth = simulate(robot, time, angle, torque, cells=cells)
    turns = []
    for k in range(2 * motion.cycles + 1):
        nominal = motion.begin + 0.5 * k * motion.period
        near = np.abs(truth.time - nominal) < 0.2 * motion.period
        towards = truth.joint_angle[near, 0] * (-1.0) ** k
        turns.append(float(truth.time[near][np.argmax(towards)]))
        if towards.max() < 0.999 * motion.amplitude:
            raise UsageError(
                f"a sine of {motion.frequency:g} Hz is too fast for the rig's motor: the joint "
                f"has not reached its limit by {truth.time[near][-1]:.4g} s"
            )
    return truth, np.array(turns)


def _forces(layout: Layout, tension: Table, nodal_force: Table) -> Forces:
    """Columns by channel; friction at a pulley is the tension after it less that before it."""
    forces = {
        f"tension/{name}": column for name, column in zip(layout.elements, tension.T, strict=True)
    }
    for name, column in zip(layout.pulleys, nodal_force.T, strict=True):
        cable, node = name.split("/")
        before, after = (forces[f"tension/{cable}/{int(node) - k}"] for k in (1, 0))
        forces |= {f"nodal_force/{name}": column, f"friction/{name}": after - before}
    return forces


def _at(times: Vector, known: Vector, table: Table) -> Table:
    """Columns interpolated at other times."""
    return np.stack([np.interp(times, known, column) for column in table.T], axis=1)


def _times(end: float, rate: float, phase_s: float = 0.0) -> Vector:
    """Times [s] at which a sensor of this rate reads within [0, end]."""
    return phase_s + np.arange(int((end - phase_s) * rate + 1e-9) + 1) / rate


def _stamps(times: Vector) -> Stamps:
    return EPOCH_NS + np.round(times * 1e9).astype(np.int64)
