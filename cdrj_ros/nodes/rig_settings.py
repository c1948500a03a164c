"""The rig's parameters, and the simulation that they and the rig file describe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from rclpy.node import Node
from rclpy.parameter import Parameter

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.robot_description import ROBOT_SETTINGS, given_model
from cdrj_ros.nodes.settings import Setting, as_double, declare, values_of
from cdrj_ros.simulation.drives import MOTIONS, DriveLimits, MotionName, drive_limits
from cdrj_ros.simulation.live import LiveSettings
from cdrj_ros.simulation.load import Load, usual_load, usual_payload
from cdrj_ros.simulation.rig_file import LoadChoice, load_rig
from cdrj_ros.simulation.sensors import SensorSettings

USUAL: Final = -1.0
"""Value of ``payload`` for which the rig file's or the default is used."""

USUAL_DAMPING: Final = 0.05
"""Default damping of the free joint [N m s/rad]."""

LARGEST_PAYLOAD: Final = 1e4

SETTINGS: Final = (
    *ROBOT_SETTINGS,
    Setting(
        "preload", Parameter.Type.DOUBLE_ARRAY,
        "Preload of every cable; unset: the robot file's", "N",
    ),
    Setting(
        "rig", "",
        "Rig file (YAML) with sensors, drives, load and faults, or the name of an installed one; "
        "empty: ideal",
    ),
    Setting("joint", "", "Joint that moves freely; empty: the first"),
    Setting(
        "payload", USUAL,
        f"Mass that the joint carries; {USUAL:g}: the rig file's, or 0.3, or less if the joint "
        "would sag far",
        "kg", USUAL, LARGEST_PAYLOAD, changeable=True,
    ),
    Setting(
        "motion", "none", "Motion of the free joint until the first command", choices=MOTIONS
    ),
    Setting("cells", 8, "Contact cells per pulley", low=1, high=200),
    Setting("rate", 1000.0, "Steps of the simulation per second", "Hz", 50.0, 10_000.0),
    Setting(
        "truth_rate", 0.0,
        "Rate of truth/tensions, truth/nodal_forces and truth/states; 0: not published",
        "Hz", 0.0, 2000.0,
    ),
    Setting("drive_clock", False, "Whether to publish the rig's time on /clock"),
    Setting(
        "speed", 1.0,
        "Seconds of the rig per second of real time; other than 1 only with drive_clock",
        "-", 0.01, 100.0,
    ),
    Setting("seed", 0, "Seed of all random numbers", low=0, high=2**31),
)  # fmt: skip
"""Every parameter of the rig."""


@dataclass(frozen=True)
class RigOptions:
    """The values of all parameters, with the content of the rig file."""

    settings: LiveSettings
    limits: DriveLimits
    motion: MotionName
    load_of: Callable[[float], Load]
    """The load by the parameter ``payload`` [kg]."""
    sensors: SensorSettings
    truth_rate: float
    """Rate of the truth topics [Hz]; 0: they are not published."""
    drive_clock: bool
    speed: float
    """Simulated time per real time [-]."""
    seed: int


def declare_rig(node: Node) -> tuple[Model, RigOptions]:
    """Declare and check every parameter, and read the robot file and the rig file.

    Raises:
        CdrjError: a value or a file is invalid.
    """
    declare(node, SETTINGS)
    given = values_of(node, SETTINGS)
    model = given_model(node, given["robot"], given["preload"])
    joint = _joint(model, given["joint"])
    if given["speed"] != 1.0 and not given["drive_clock"]:
        raise UsageError(
            f"speed {given['speed']:g} needs drive_clock:=true: stamps would leave the clock"
        )
    rig = load_rig(given["rig"])
    load_of = _loads(model, joint, rig.load)
    in_bags_only = "max_acceleration"
    limits = {key: value for key, value in rig.drives.items() if key != in_bags_only}
    rate = given["rate"]
    lower, upper = rig.load.stops or (None, None)
    settings = LiveSettings(
        load_of(given["payload"]), given["cells"], rate, joint, lower, upper, faults=rig.faults
    )
    return model, RigOptions(
        settings,
        drive_limits(model.robot, rate, **limits),
        given["motion"],
        load_of,
        rig.sensors,
        given["truth_rate"],
        given["drive_clock"],
        given["speed"],
        given["seed"],
    )


def changed_payload(options: RigOptions, changes: Sequence[Parameter]) -> Load | None:
    """The load after a change of parameters; None if the change does not concern it."""
    for change in changes:
        if change.name == "payload":
            return options.load_of(float(change.value))
    return None


def meant(changes: Sequence[Parameter]) -> list[Parameter]:
    """The changes with integers converted to doubles: a payload of 1 means 1.0."""
    return [as_double(change, 0.0) if change.name == "payload" else change for change in changes]


def _joint(model: Model, name: str) -> int:
    joints = model.layout.joints
    if not joints:
        raise UsageError(f"the rig moves a joint, and {model.robot.name} has none")
    if name and name not in joints:
        raise UsageError(f"joint must be one of {', '.join(joints)}, got {name!r}")
    return joints.index(name) if name else 0


def _loads(model: Model, joint: int, given: LoadChoice) -> Callable[[float], Load]:
    """The load by the parameter ``payload``."""
    kind = given.kind or usual_load(model.robot, joint)
    usual = usual_payload(model.robot, joint, kind, given.gravity)

    def load_of(payload: float) -> Load:
        chosen = given if payload < 0.0 else replace(given, payload=payload)
        return chosen.made(kind, usual, USUAL_DAMPING)

    return load_of
