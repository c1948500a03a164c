"""The source's experiments on the simulated rig: measurements and estimates.

The rig is made with the values of rho that the source identified on its own rig, cable by cable
and preload by preload.  Figures 12 and 13 are estimated with the one rho = 0.2 that the source
uses there, figure 14 with the identified values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.evaluation.channels import FRICTION, Angle, Channel
from cdrj_ros.evaluation.comparison import Comparing
from cdrj_ros.evaluation.validation import MAX_GAP_NS
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import NODAL_FORCE, TENSION
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Cable, Friction, Pulley, Robot, Sensor
from cdrj_ros.simulation.assembly import Truth
from cdrj_ros.simulation.sensors import (
    JOINT_ENCODER,
    MOTOR_ENCODER,
    Encoder,
    LoadCells,
    counted,
    measured,
)
from cdrj_ros.simulation.truth import simulate
from examples.paper.joint import RollingLoad

Vector = NDArray[np.float64]

CABLES: Final = ("upper", "lower")
"""The source's two cables, in its order."""

COMMON_RHO: Final = (0.2, 0.2)
"""rho of both cables in figures 12 and 13."""

FREE_PRELOAD: Final = (20.0, 20.0)
"""Preload of both cables in figure 9 [N]."""

FREE_RHOS: Final = (0.0, 0.2, 1.0)
"""rho in figure 9: bearings alone, the source's common value, sliding alone."""

EPOCH_NS: Final = 1_000_000_000
"""Stamp of the start of a run [ns]."""


@dataclass(frozen=True)
class Experiment:
    """One set of preloads of the source, and the rho that it identified there."""

    name: str
    preload: tuple[float, float]
    """Preloads of the upper and lower cable [N]."""
    rho: tuple[float, float]
    """rho of the upper and lower cable, identified by (44) [-]."""


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
class Recording:
    """Result of an experiment: encoder and load cell readings, and the truth."""

    truth: Truth
    samples: Samples
    """Conditioned samples of the encoders."""
    stamp_ns: NDArray[np.int64]
    """Stamps of the load cells' readings [ns], shape (n,)."""
    readings: Mapping[str, Vector]
    """Readings of the load cells by channel name [N], shape (n,) each."""
    noiseless: Mapping[str, Vector]
    """The true values at the same stamps [N], shape (n,) each."""
    turns: tuple[float, ...]
    """Times at which the joint turns, from an upper limit to an upper limit [s]."""


@dataclass(frozen=True)
class Free:
    """The model's tensions for a prescribed joint motion, without measurements."""

    time: Vector
    """Time from the first upper limit [s], shape (n,)."""
    angle: Vector
    """Joint angle [rad], shape (n,)."""
    tension: Mapping[str, Vector]
    """Tensions by ``cable/element`` [N], shape (n,) each."""


def with_friction(
    robot: Robot,
    *,
    preload: Sequence[float] | None = None,
    rho: Sequence[float] | None = None,
    law: str | None = None,
    **numbers: float | str,
) -> Robot:
    """The robot with other preloads [N] and rho by cable, another law or ``Friction`` fields."""

    def changed(friction: Friction, k: int) -> Friction:
        fields: dict[str, float | str] = dict(numbers)
        if rho is not None:
            fields["rho"] = rho[k]
        return replace(friction, **fields)  # type: ignore[arg-type]

    def cable_with(cable: Cable, k: int) -> Cable:
        nodes = tuple(
            replace(node, friction=changed(node.friction, k)) if isinstance(node, Pulley) else node
            for node in cable.nodes
        )
        return replace(
            cable,
            nodes=nodes,
            law=cable.law if law is None else law,
            preload=cable.preload if preload is None else preload[k],
        )

    return replace(
        robot, cables=tuple(cable_with(cable, k) for k, cable in enumerate(robot.cables))
    )


def with_constant_wraps(robot: Robot) -> Robot:
    """The robot with every wrap held at the middle of its range, as (3) of the source assumes."""

    def held(node: Pulley) -> Pulley:
        wrap = tuple(
            profile
            if profile.joint is None
            else replace(
                profile,
                value=np.full_like(profile.value, 0.5 * (profile.value[0] + profile.value[-1])),
                slope=np.zeros_like(profile.slope),
            )
            for profile in node.wrap
        )
        return replace(node, wrap=wrap)

    return replace(
        robot,
        cables=tuple(
            replace(
                cable,
                nodes=tuple(held(n) if isinstance(n, Pulley) else n for n in cable.nodes),
            )
            for cable in robot.cables
        ),
    )


def _times(end: float, rate: float, phase_s: float = 0.0) -> NDArray[np.float64]:
    """Times [s] at which a sensor of this rate reads within [0, end]."""
    return phase_s + np.arange(int((end - phase_s) * rate + 1e-9) + 1) / rate


def record(robot: Robot, motion: Motion, *, cells: int = 8, seed: int = 0) -> Recording:
    """Run an experiment on the rig: truth with contact cells, then encoders and load cells.

    Args:
        robot: robot with the preloads and the friction of the rig.
        motion: motion of the joint.
        cells: contact cells per pulley.
        seed: seed of the load cells' noise.
    """
    truth = _moved(robot, motion, RollingLoad(), cells)
    layout = prepare(robot).layout
    end = float(truth.time[-1])

    def angles(encoder: Encoder, values: NDArray[np.float64]) -> Series:
        times = _times(end, min(encoder.rate, motion.rate), encoder.phase)
        stamps = _stamps(times)
        angle = np.interp(times, truth.time, _column(values))
        return Series(stamps, stamps, counted(encoder, angle, 0.0, Sensor()))

    conditioned = condition(
        robot,
        {layout.motors[0]: angles(MOTOR_ENCODER, truth.motor_angle)},
        {layout.joints[0]: angles(JOINT_ENCODER, truth.joint_angle)},
    )
    cell = LoadCells()
    times = _times(end, cell.rate)
    generator = np.random.default_rng(seed)
    readings, noiseless = {}, {}
    for prefix, names, values in (
        (TENSION, layout.elements, truth.tension),
        (NODAL_FORCE, layout.pulleys, truth.nodal_force),
    ):
        ideal = np.stack([np.interp(times, truth.time, column) for column in values.T], axis=1)
        read = measured(ideal, cell.noise, cell.step, generator)
        for k, name in enumerate(names):
            readings[f"{prefix}/{name}"], noiseless[f"{prefix}/{name}"] = read[:, k], ideal[:, k]
    for name in layout.pulleys:
        cable, node = name.split("/")
        for forces in (readings, noiseless):
            before, after = (forces[f"{TENSION}/{cable}/{int(node) - k}"] for k in (1, 0))
            forces[f"friction/{name}"] = after - before
    turns = _turns(truth.time, _column(truth.joint_angle), motion)
    return Recording(truth, conditioned.segments[0], _stamps(times), readings, noiseless, turns)


def estimate(recording: Recording, robot: Robot) -> dict[str, Channel]:
    """The estimator over a recording's encoders, beside its load cells, within the cycles.

    Args:
        recording: from ``record``.
        robot: the estimator's preloads, rho and law.

    Returns:
        Channels ``tension/cable/element``, ``nodal_force/cable/node`` and ``friction/cable/node``.
    """
    model = prepare(robot)
    samples, layout = recording.samples, model.layout
    values = run(model, initial_state(model), samples)[1].values
    named = {
        f"{prefix}/{name}": values[:, part.start + k]
        for prefix, names, part in (
            (TENSION, layout.elements, layout.tension),
            (NODAL_FORCE, layout.pulleys, layout.magnitude),
            (FRICTION, layout.pulleys, layout.friction),
        )
        for k, name in enumerate(names)
    }
    ends = _stamps(np.array([recording.turns[0], recording.turns[-1]]))
    kept = (recording.stamp_ns >= ends[0]) & (recording.stamp_ns <= ends[1])
    stamps = recording.stamp_ns[kept]
    references = {
        name: Series(stamps, stamps, reading[kept]) for name, reading in recording.readings.items()
    }
    angle = Angle(layout.joints[0], samples.stamp_ns, samples.joint_angle[:, 0])
    comparing = Comparing(list(named), samples.stamp_ns, references, MAX_GAP_NS)
    comparing.add(named, {}, len(samples.stamp_ns))
    return {channel.name: channel for channel in comparing.channels(angle, None)}


def move_freely(
    robot: Robot,
    motion: Motion,
    load: RollingLoad | None = None,
    *,
    lever: float = 1.0,
) -> Free:
    """Tensions of the lumped model for a prescribed joint motion: the source's simulation.

    Args:
        robot: robot with its preloads and friction.
        motion: motion of the joint.
        load: masses; the prototype's by default.
        lever: share of the true lever arm at which the strands pull, 0.5 for (10) as printed.

    Raises:
        UsageError: a cable would have to push.
    """
    truth = _moved(robot, motion, load or RollingLoad(), 1, lever)
    angle = _column(truth.joint_angle)
    turns = _turns(truth.time, angle, motion)
    kept = (truth.time >= turns[0]) & (truth.time <= turns[-1])
    names = prepare(robot).layout.elements
    return Free(
        truth.time[kept] - turns[0],
        angle[kept],
        {name: truth.tension[kept, k] for k, name in enumerate(names)},
    )


def _moved(
    robot: Robot,
    motion: Motion,
    load: RollingLoad,
    cells: int,
    lever: float = 1.0,
) -> Truth:
    time, angle, speed, acceleration = motion.path()
    torque = load.torque(angle, speed, acceleration) / lever
    return simulate(robot, time, angle, torque, cells=cells)


def _column(values: NDArray[np.float64]) -> Vector:
    """Angle of the only motor or joint."""
    return np.ascontiguousarray(np.reshape(values, (len(values), -1))[:, 0])


def _stamps(times: Vector) -> NDArray[np.int64]:
    return EPOCH_NS + np.round(times * 1e9).astype(np.int64)


def _turns(time: Vector, angle: Vector, motion: Motion) -> tuple[float, ...]:
    """Times at which the joint turned, a little later than prescribed since it waits at reversals.

    Raises:
        UsageError: it did not reach a limit.
    """
    turns = []
    for k in range(2 * motion.cycles + 1):
        nominal = motion.begin + 0.5 * k * motion.period
        near = np.abs(time - nominal) < 0.2 * motion.period
        sign = 1.0 if k % 2 == 0 else -1.0
        turn = int(np.argmax(sign * angle[near]))
        if sign * angle[near][turn] < 0.999 * motion.amplitude:
            raise UsageError(
                f"a sine of {motion.frequency:g} Hz is too fast for the rig's motor: the joint "
                f"has not reached its limit by {time[near][-1]:.4g} s"
            )
        turns.append(float(time[near][turn]))
    return tuple(turns)
