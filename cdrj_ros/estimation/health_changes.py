"""Changes of a robot that measured efforts and tensions can show, each as a changed model.

The difference of the changed model's readings from the file's is the signature of the change.  See
docs/reliability.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import degrees, inf, radians
from typing import Final, Literal

from cdrj_ros.robot.axes import DEFAULT_BREAKAWAY_ANGLE
from cdrj_ros.robot.description import Cable, Motor, Pulley, Robot, Uncertainty, Winch

Kind = Literal["preload", "zero", "friction", "motor friction", "sensor", "broken"]

PRELOAD_SHARE: Final = 0.05
"""Smallest reported change of a preload, as a fraction of it."""

ZERO: Final = radians(0.3)
"""Smallest reported error of a joint's zero [rad]."""

ZERO_M: Final = 3e-4
"""The same of a prismatic joint [m]."""

FRICTION_SHARE: Final = 0.25
"""Smallest reported change of the coefficients of friction, as a fraction."""

DRAG_SHARE: Final = 0.02
"""Smallest reported load-independent friction of the pulleys, as a fraction of the preload."""

MOTOR_FRICTION_SHARE: Final = 0.03
"""Smallest reported friction of a motor, as a fraction of the torque of all its preloads."""

GAIN: Final = 0.05
"""Smallest reported error of a sensor's scale, as a fraction."""

OFFSET_SHARE: Final = 0.06
"""Smallest reported error of a sensor's zero, as a fraction of the preload or of its torque."""

LOST_STIFFNESS: Final = 1e-9
"""Stiffness of a broken cable, as a fraction of the file's."""

LEAST_PRELOAD: Final = 0.5
"""A cable with less preload has none to lose [N]."""


@dataclass(frozen=True)
class Change:
    """One way in which the robot may differ from its file, by the smallest reported amount."""

    kind: Kind
    what: str
    """``preload of upper``."""
    unit: str
    size: float
    """Amount of this change in ``unit``, as printed."""
    tolerance: float
    """Standard deviation of the amount that the robot file leaves open, in ``unit``."""
    robot: Robot | None = None
    """The changed robot; None if only a reading changes."""
    joint_shift: tuple[float, ...] = ()
    """True angles less readings of all joints [rad]; empty for zeros."""
    channel: str = ""
    """Sensor whose reading changes: a motor, or ``cable/element``."""
    gain: float = 0.0
    """Change of that reading as a fraction."""
    offset: float = 0.0
    """Change of that reading [N] or [N m]."""


def changes_of(robot: Robot, known: Uncertainty | None) -> list[Callable[[], Change]]:
    """Makers of all changes of the robot itself; each prepares one changed robot.

    Args:
        robot: the robot as its file describes it.
        known: what is uncertain about the file's numbers; None: nothing.
    """
    loose = known.stddev if known else {}
    tight = [
        cable for cable in robot.cables if cable.preload >= LEAST_PRELOAD and not cable.rest_length
    ]
    makers: list[Callable[[], Change]] = [
        partial(_preload, robot, [cable], loose) for cable in tight
    ]
    if len(tight) > 1:
        makers.append(partial(_preload, robot, tight, loose))
    makers += [partial(_zero, robot, j, loose) for j in range(len(robot.joints))]
    if any(p.friction.mu_c > 0.0 for cable in robot.cables for p in cable.pulleys):
        makers.append(partial(_friction, robot, loose))
    if any(p.radius > 0.0 for cable in tight for p in cable.pulleys):
        makers.append(partial(_drag, robot, loose))
    makers += [
        partial(_motor_friction, robot, motor, loose)
        for motor in robot.motors
        if preload_torque(robot, motor.name) > 0.0
    ]
    makers += [partial(_broken, robot, cable) for cable in tight]
    return makers


def sensor_changes(robot: Robot, channels: Sequence[str]) -> list[Change]:
    """Errors of scale and zero of the sensors themselves."""
    found = []
    for channel in channels:
        what, unit = (f"effort of {channel}", "N m") if is_effort(robot, channel) else (
            f"load cell {channel}", "N"
        )  # fmt: skip
        offset = OFFSET_SHARE * magnitude(robot, channel)
        found.append(
            Change("sensor", f"scale of {what}", "%", 100.0 * GAIN, 0.0, channel=channel, gain=GAIN)
        )
        if offset > 0.0:
            found.append(
                Change("sensor", f"zero of {what}", unit, offset, 0.0, channel=channel,
                       offset=offset)
            )  # fmt: skip
    return found


def is_effort(robot: Robot, channel: str) -> bool:
    """Whether a sensor is a motor's effort [N m], not a load cell [N]."""
    return any(motor.name == channel for motor in robot.motors)


def magnitude(robot: Robot, channel: str) -> float:
    """The reading that all preloads together would give [N] or [N m]."""
    if is_effort(robot, channel):
        return preload_torque(robot, channel)
    name = channel.rpartition("/")[0]
    return next((cable.preload for cable in robot.cables if cable.name == name), 0.0)


def preload_torque(robot: Robot, motor: str) -> float:
    """Torque of all preloads on a motor, added up regardless of their direction [N m]."""
    return sum(
        cable.preload * node.radius
        for cable in robot.cables
        for node in cable.nodes
        if isinstance(node, Winch) and node.motor == motor
    )


def _with_cables(robot: Robot, changed: Callable[[Cable], Cable]) -> Robot:
    return replace(robot, cables=tuple(changed(cable) for cable in robot.cables))


def _with_pulleys(robot: Robot, changed: Callable[[Cable, Pulley], Pulley]) -> Robot:
    return _with_cables(
        robot,
        lambda cable: replace(
            cable,
            nodes=tuple(
                changed(cable, node) if isinstance(node, Pulley) else node for node in cable.nodes
            ),
        ),
    )


def _preload(robot: Robot, cables: Sequence[Cable], loose: dict[str, float]) -> Change:
    """A loss of preload, of one cable or of all by the same share."""
    names = {cable.name for cable in cables}
    changed = _with_cables(
        robot,
        lambda cable: (
            replace(cable, preload=cable.preload * (1.0 - PRELOAD_SHARE))
            if cable.name in names
            else cable
        ),
    )
    shares = [loose.get(f"cables.{c.name}.preload", 0.0) / c.preload for c in cables]
    if len(cables) > 1:
        return Change("preload", "preload of all cables", "%", -100.0 * PRELOAD_SHARE,
                      100.0 * max(shares), changed)  # fmt: skip
    cable = cables[0]
    return Change(
        "preload", f"preload of {cable.name}", "N", -PRELOAD_SHARE * cable.preload,
        shares[0] * cable.preload, changed,
    )  # fmt: skip


def _zero(robot: Robot, j: int, loose: dict[str, float]) -> Change:
    joint = robot.joints[j]
    tolerance = loose.get(f"joints.{joint.name}.reference_angle", 0.0)
    prismatic = joint.name in robot.prismatic_joints
    shift = ZERO_M if prismatic else ZERO
    shifts = tuple(-shift if k == j else 0.0 for k in range(len(robot.joints)))
    unit, scale = ("mm", 1e3) if prismatic else ("deg", degrees(1.0))
    return Change(
        "zero", f"zero of joint {joint.name}", unit, shift * scale, tolerance * scale, robot,
        joint_shift=shifts,
    )  # fmt: skip


def _friction(robot: Robot, loose: dict[str, float]) -> Change:
    def more(_cable: Cable, pulley: Pulley) -> Pulley:
        own = pulley.friction
        factor = 1.0 + FRICTION_SHARE
        return replace(
            pulley, friction=replace(own, mu_c=own.mu_c * factor, mu_s=own.mu_s * factor)
        )

    given = [p.friction.mu_c for cable in robot.cables for p in cable.pulleys]
    spread = [stddev for path, stddev in loose.items() if path.endswith("mu_c")]
    tolerance = 100.0 * max(spread, default=0.0) / max(given)
    return Change("friction", "friction of the pulleys (coefficients)", "%",
                  100.0 * FRICTION_SHARE, tolerance,
                  _with_pulleys(robot, more))  # fmt: skip


def _drag(robot: Robot, loose: dict[str, float]) -> Change:
    def more(cable: Cable, pulley: Pulley) -> Pulley:
        torque = DRAG_SHARE * cable.preload * pulley.radius
        return replace(pulley, bearing_torque=pulley.bearing_torque + torque)

    forces = [
        stddev / max(cable.preload * cable.pulleys[0].radius, 1e-12)
        for cable in robot.cables
        if cable.pulleys
        for path, stddev in loose.items()
        if path.startswith(f"cables.{cable.name}.") and path.endswith("bearing_torque")
    ]
    return Change("friction", "friction of the pulleys (drag)", "% of preload", 100.0 * DRAG_SHARE,
                  100.0 * max(forces, default=0.0), _with_pulleys(robot, more))  # fmt: skip


def _motor_friction(robot: Robot, motor: Motor, loose: dict[str, float]) -> Change:
    torque = MOTOR_FRICTION_SHARE * preload_torque(robot, motor.name)
    total = motor.passive.bearing_torque + torque
    stiffness = motor.passive.bearing_stiffness or total / DEFAULT_BREAKAWAY_ANGLE
    passive = replace(motor.passive, bearing_torque=total, bearing_stiffness=stiffness)
    changed = replace(
        robot,
        motors=tuple(
            replace(one, passive=passive) if one.name == motor.name else one for one in robot.motors
        ),
    )
    return Change(
        "motor friction", f"friction of motor {motor.name}", "N m", torque,
        loose.get(f"motors.{motor.name}.bearing_torque", 0.0), changed,
    )  # fmt: skip


def _broken(robot: Robot, cable: Cable) -> Change:
    changed = _with_cables(
        robot,
        lambda one: replace(
            one, preload=0.0, axial_stiffness=one.axial_stiffness * LOST_STIFFNESS,
            maximum_tension=inf,
        )
        if one.name == cable.name
        else one,
    )  # fmt: skip
    return Change("broken", f"cable {cable.name}", "", 1.0, 0.0, changed)
