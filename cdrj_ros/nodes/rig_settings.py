"""The rig's parameters: the simulation, its sensors, and the published topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, cast

from rclpy.node import Node
from rclpy.parameter import Parameter

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.rig_declaring import (
    declare_count,
    declare_flag,
    declare_names,
    declare_number,
    declare_numbers,
    declare_text,
)
from cdrj_ros.nodes.settings import as_double
from cdrj_ros.simulation.live import LiveSettings
from cdrj_ros.simulation.live_limits import DriveLimits, drive_limits
from cdrj_ros.simulation.live_motion import MOTIONS, Demonstration, MotionName
from cdrj_ros.simulation.load import KINDS as LOADS
from cdrj_ros.simulation.load import Load, LoadKind, make_load, usual_load, usual_payload
from cdrj_ros.simulation.sensors import JOINT_ENCODER, MOTOR_ENCODER, Encoder, LoadCells

USUAL: Final = 0.0
"""Value of a parameter for which the rig chooses a default."""

LOAD_PARAMETERS: Final = ("payload", "gravity", "damping")
"""Parameters that may change while the rig runs."""


@dataclass(frozen=True)
class Reader:
    """One kind of encoder and the latency of its messages."""

    encoder: Encoder
    latency_s: float
    """Time from a reading to its message [s]."""


@dataclass(frozen=True)
class RigOptions:
    """The values of all parameters."""

    settings: LiveSettings
    limits: DriveLimits
    demonstration: Demonstration
    load_kind: LoadKind
    motors: Reader
    joints: Reader
    efforts: LoadCells | None
    """Noise and resolution of the torque in motor_states; None: no torque is published."""
    load_cells: tuple[int, ...]
    """Indices of the elements with a load cell."""
    cells: LoadCells
    truth_rate: float
    """Rate of the truth topics [Hz]; 0: they are not published."""
    drive_clock: bool
    speed: float
    """Simulated time per real time [-]."""
    seed: int


def declare_rig_options(node: Node, model: Model) -> RigOptions:
    """Declare and check every parameter except ``robot`` and ``preload``.

    Longer than a screen because each parameter is declared with its range and description.

    Raises:
        UsageError: a value is invalid.
    """
    joint = _joint(
        model, declare_text(node, "joint", "", "Joint that moves freely; empty: the first")
    )
    kind, load = _load(node, model, joint)
    stop = declare_numbers(
        node, "stop", "End stops of the free joint, lower and upper [rad] or [m]; unset: its range"
    )
    if len(stop) not in (0, 2):
        raise UsageError(f"stop needs two numbers, lower and upper, got {len(stop)}")
    rate = declare_number(
        node, "rate", 1000.0, 50.0, 10_000.0, "Steps of the simulation per second [Hz]"
    )
    settings = LiveSettings(
        load,
        cells=declare_count(node, "cells", 8, 1, 200, "Contact cells per pulley"),
        rate=rate,
        joint=joint,
        lower=stop[0] if stop else None,
        upper=stop[1] if stop else None,
    )
    drive_clock = declare_flag(
        node, "drive_clock", False, "Whether to publish the rig's time on /clock"
    )
    speed = declare_number(
        node,
        "speed",
        1.0,
        0.01,
        100.0,
        "Seconds of the rig per second of real time; other than 1 only with drive_clock [-]",
    )
    if speed != 1.0 and not drive_clock:
        raise UsageError(f"speed {speed:g} needs drive_clock:=true: stamps would leave the clock")
    seed = declare_count(node, "seed", 0, 0, 2**31, "Seed of all random numbers")
    sensors = _declare_sensors(node)
    return RigOptions(
        settings=settings,
        limits=_limits(node, model, rate),
        demonstration=_demonstration(node, seed),
        load_kind=kind,
        motors=sensors[0],
        joints=sensors[1],
        efforts=_efforts(node, sensors[0].encoder),
        load_cells=_elements(node, model),
        cells=LoadCells(
            rate=declare_number(
                node, "load_cell_rate", 100.0, 0.1, 5000.0, "Rate of load cells [Hz]"
            ),
            force_noise=declare_number(
                node, "load_cell_noise", 0.02, 0.0, 1e4, "Standard deviation of load cells [N]"
            ),
        ),
        truth_rate=declare_number(
            node,
            "truth_rate",
            0.0,
            0.0,
            2000.0,
            "Rate of truth/tensions, nodal_forces and states [Hz]; 0: not published",
        ),
        drive_clock=drive_clock,
        speed=speed,
        seed=seed,
    )


def changed_load(options: RigOptions, load: Load, changes: Sequence[Parameter]) -> Load | None:
    """The load after a change of parameters; None if the change does not concern the load.

    Raises:
        UsageError: the load is invalid.
    """
    body = cast(Any, load.body)
    given = {"payload": body.load_mass, "gravity": body.gravity, "damping": load.damping}
    concerned = [change for change in changes if change.name in LOAD_PARAMETERS]
    for change in concerned:
        given[change.name] = float(change.value)
    if not concerned:
        return None
    return make_load(options.load_kind, given["payload"], given["damping"], given["gravity"])


def _joint(model: Model, name: str) -> int:
    joints = model.layout.joints
    if not joints:
        raise UsageError(f"the rig moves a joint, and {model.robot.name} has none")
    if name and name not in joints:
        raise UsageError(f"joint must be one of {', '.join(joints)}, got {name!r}")
    return joints.index(name) if name else 0


def _load(node: Node, model: Model, joint: int) -> tuple[LoadKind, Load]:
    name = declare_text(
        node,
        "load",
        "",
        f"Kind of load: {', '.join(LOADS)}; empty: depends on the joint's frame",
    )
    if name and name not in LOADS:
        raise UsageError(f"load must be one of {', '.join(LOADS)}, got {name!r}")
    kind: LoadKind = name or usual_load(model.robot, joint)
    gravity = declare_number(
        node,
        "gravity",
        9.81,
        -100.0,
        100.0,
        "Gravity against positive joint angle [m/s^2]",
        changeable=True,
    )
    damping = declare_number(
        node, "damping", 0.05, 0.0, 1e6, "Damping of the joint [N m s/rad]", changeable=True
    )
    mass = declare_number(
        node,
        "payload",
        usual_payload(model.robot, joint, kind, gravity),
        0.0,
        1e4,
        "Mass that the joint carries [kg]; default: 0.3, or less if the joint would sag far",
        changeable=True,
    )
    return kind, make_load(kind, mass, damping, gravity)


def _limits(node: Node, model: Model, rate: float) -> DriveLimits:
    speed = declare_number(
        node,
        "motor_speed",
        USUAL,
        USUAL,
        1e4,
        "Largest speed of a motor [rad/s]; 0: 10, or max_speed if that is lower",
    )
    torque = declare_number(
        node,
        "motor_torque",
        USUAL,
        USUAL,
        1e6,
        "Largest torque of a motor [N m]; 0: that of one cable at max_tension, or 10",
    )
    inertia = declare_number(
        node,
        "rotor_inertia",
        USUAL,
        USUAL,
        1e3,
        "Inertia of rotor and drum, for effort commands [kg m^2]; 0: default",
    )
    return drive_limits(
        model.robot,
        rate,
        speed=speed or None,
        torque=torque or None,
        inertia=inertia or None,
        damping=declare_number(node, "rotor_damping", 1e-3, 0.0, 1e3, "Rotor damping [N m s/rad]"),
        timeout_s=declare_number(
            node,
            "command_timeout",
            0.5,
            0.001,
            3600.0,
            "Time without a velocity or effort command after which a motor holds its angle [s]",
        ),
    )


def _demonstration(node: Node, seed: int) -> Demonstration:
    kind = declare_text(
        node,
        "motion",
        "none",
        f"Motion of the free joint until the first command: {', '.join(MOTIONS)}",
    )
    amplitude = declare_number(
        node,
        "motion_amplitude",
        USUAL,
        USUAL,
        1e3,
        "Amplitude of that motion [rad] or [m]; 0: 0.6 of what the range allows",
    )
    frequency = declare_number(node, "motion_frequency", 0.2, 1e-3, 10.0, "Frequency [Hz]")
    return Demonstration(cast(MotionName, kind), amplitude or None, frequency, seed)


def _declare_sensors(node: Node) -> tuple[Reader, Reader]:
    readers = []
    for name, usual in (("motor", MOTOR_ENCODER), ("joint", JOINT_ENCODER)):
        encoder = replace(
            usual,
            rate=declare_number(
                node, f"{name}_rate", usual.rate, 1.0, 5000.0, "Rate of the encoders [Hz]"
            ),
            counts=declare_count(
                node, f"{name}_counts", usual.counts, 1, 2**40, "Counts of the encoders per turn"
            ),
            noise=declare_number(
                node, f"{name}_noise", 0.0, 0.0, 10.0, "Standard deviation of the encoders [rad]"
            ),
            jitter_s=declare_number(
                node, f"{name}_jitter", 0.0, 0.0, 1.0, "Standard deviation of the stamps [s]"
            ),
            dropout=declare_number(
                node, f"{name}_dropout", 0.0, 0.0, 0.99, "Share of readings lost [-]"
            ),
        )
        latency_s = declare_number(
            node, f"{name}_latency", 0.0, 0.0, 10.0, "Time from a reading to its message [s]"
        )
        readers.append(Reader(encoder, latency_s))
    return readers[0], readers[1]


def _efforts(node: Node, encoder: Encoder) -> LoadCells | None:
    wanted = declare_flag(
        node,
        "motor_efforts",
        False,
        "Whether motor_states carry the torque of the cables on the motors",
    )
    noise = declare_number(
        node,
        "motor_effort_noise",
        LoadCells.torque_noise,
        0.0,
        1e4,
        "Standard deviation of that torque [N m]",
    )
    return LoadCells(rate=encoder.rate, torque_noise=noise) if wanted else None


def _elements(node: Node, model: Model) -> tuple[int, ...]:
    names = declare_names(
        node, "load_cells", "Elements with a load cell on tension_sensors (upper/8); unset: none"
    )
    elements = model.layout.elements
    for name in names:
        if name not in elements:
            raise UsageError(f"load_cells must be of {', '.join(elements)}, got {name!r}")
    return tuple(dict.fromkeys(elements.index(name) for name in names))


def meant(changes: Sequence[Parameter]) -> list[Parameter]:
    """The changes with integers converted to doubles: a payload of 1 means 1.0."""
    return [
        as_double(change, 0.0) if change.name in LOAD_PARAMETERS else change for change in changes
    ]
