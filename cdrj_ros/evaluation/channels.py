"""Channels: one quantity each, estimated and recorded, at the stamps of the reference; friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.evaluation.recorded_verdict import Verdict
from cdrj_ros.foundation.arrays import Floats, Stamps
from cdrj_ros.messages import cdr
from cdrj_ros.model.packing import (
    EFFORT,
    NODAL_FORCE,
    TENSION,
    Layout,
    channel_columns,
    stddev_places,
)
from cdrj_ros.model.prepared import Model, shape_at


@dataclass(frozen=True)
class PulleyFriction:
    """Friction at one pulley; its share is |t_i - t_(i-1)| over the larger of the two tensions."""

    name: str
    """Name of the pulley, ``cable/node``."""
    mean: float
    """Mean |t_i - t_(i-1)| [N]."""
    largest: float
    """Largest |t_i - t_(i-1)| [N]."""
    mean_share: float
    """Mean share over the samples in which the cable is taut [-]."""
    largest_share: float
    """Largest share [-]."""


class FrictionSums:
    """Accumulates friction over estimates that are given in pieces."""

    def __init__(self, layout: Layout) -> None:
        """Start with empty sums for the pulleys of a robot."""
        self._layout = layout
        self._sum, self._largest, self._share_sum, self._largest_share, self._taut = np.zeros(
            (5, len(layout.pulleys))
        )
        self._count = 0

    def add(self, values: Floats) -> None:
        """Add the next estimates, at least one, shape (n, layout.size)."""
        tension = values[:, self._layout.tension]
        friction = np.abs(values[:, self._layout.friction])
        before = self._layout.element_before
        larger = np.maximum(tension[:, before], tension[:, before + 1])
        taut = larger > 0.0
        share = np.divide(friction, larger, out=np.zeros_like(friction), where=taut)
        self._sum += friction.sum(axis=0)
        self._share_sum += share.sum(axis=0)
        self._taut += np.count_nonzero(taut, axis=0)
        self._largest = np.maximum(self._largest, friction.max(axis=0))
        self._largest_share = np.maximum(self._largest_share, share.max(axis=0))
        self._count += len(values)

    def result(self) -> tuple[PulleyFriction, ...]:
        """Friction of all pulleys; none without estimates."""
        if not self._count:
            return ()
        columns = (
            self._sum / self._count,
            self._largest,
            self._share_sum / np.maximum(self._taut, 1),
            self._largest_share,
        )
        rows = np.transpose(columns).tolist()
        return tuple(
            PulleyFriction(name, *row) for name, row in zip(self._layout.pulleys, rows, strict=True)
        )


FORCE_VECTOR: Final = cdr.FORCE_VECTOR
"""``force_vector/cable/node``, the force that ``nodal_force`` gives the magnitude of [N]."""

ANGLE: Final = "angle"
"""``angle/joint`` of a joint without encoder [rad], [m] for a prismatic joint."""


class Quantity(NamedTuple):
    """A physical quantity, named by the part of a channel's name before the first slash."""

    title: str
    """Title for headings: "Tension"."""
    unit: str
    """Unit of the channel's values: "N", "N·m" or "rad"."""
    place: str
    """What has one value each: "element", "node"."""
    several: str
    """Many channels, after their number: "element tensions"."""
    signed: bool = False
    """Whether it passes through zero, where relative errors are meaningless."""
    prismatic_unit: str = ""
    """Unit at a prismatic joint, if it is another one."""


QUANTITIES: Final[Mapping[str, Quantity]] = MappingProxyType(
    {
        TENSION: Quantity("Tension", "N", "element", "element tensions"),
        NODAL_FORCE: Quantity("Nodal force", "N", "node", "nodal forces"),
        FORCE_VECTOR: Quantity("Force vector", "N", "node", "nodal forces as vectors"),
        EFFORT: Quantity("Effort", "N·m", "effort", "efforts", True, "N"),
        ANGLE: Quantity("Angle", "rad", "angle", "angles", True, "m"),
    }
)
"""All quantities that can be compared, by prefix, in display order."""


def quantity_of(name: str) -> str:
    """Prefix of a channel's name, a key of QUANTITIES; ValueError if it is not one."""
    prefix, slash, rest = name.partition("/")
    if prefix not in QUANTITIES or not slash or not rest:
        known = ", ".join(f"{key}/…" for key in QUANTITIES)
        raise ValueError(f"channel name must be one of {known}; got {name!r}")
    return prefix


def unit_of(name: str, axis: str = "rad") -> str:
    """Unit of a channel's values, from the prefix of its name; ValueError if it is unknown.

    Args:
        name: of the channel.
        axis: unit of the angle of its motor or joint, "m" for a prismatic joint.
    """
    quantity = QUANTITIES[quantity_of(name)]
    return (axis == "m" and quantity.prismatic_unit) or quantity.unit


def estimate_channels(layout: Layout, values: Floats) -> dict[str, Floats]:
    """Views of estimates by channel name.

    Args:
        layout: of the columns of the estimates.
        values: shape (n, layout.size).

    Returns:
        Shape (n,) each, of force vectors (n, 3): x, y and z.
    """
    named = {name: values[:, column] for name, column in channel_columns(layout).items()}
    x, z = layout.force_x, layout.force_z  # y lies between them
    for k, name in enumerate(layout.pulleys):
        named[f"{FORCE_VECTOR}/{name}"] = values[:, x.start + k : z.stop : len(layout.pulleys)]
    return named


def stddev_channels(layout: Layout, stddev: Floats | None) -> dict[str, Floats]:
    """Views of standard deviations by channel name; empty if they are unknown.

    Args:
        layout: names of the channels.
        stddev: of tensions, nodal forces, motor efforts and joint efforts, shape (n, channels).
    """
    if stddev is None:
        return {}
    return {name: stddev[:, k] for name, k in stddev_places(layout).items()}


def size_of(values: Floats) -> Floats:
    """Absolute values of scalars (n,), norms of vectors (n, 3), shape (n,)."""
    return np.abs(values) if values.ndim == 1 else np.asarray(np.linalg.norm(values, axis=1))


@dataclass(frozen=True, eq=False)
class Channel:
    """One quantity, estimated and recorded, at the reference's stamps."""

    name: str
    """Name of the channel: "tension/upper/8", "nodal_force/upper/3", "force_vector/upper/3" or
    "effort/spindle"."""
    unit: str
    """Unit of ``estimate`` and ``reference``: "N", "N·m", "rad" or "m"."""
    stamp_ns: Stamps
    """Stamps of the reference [ns], strictly increasing, shape (n,)."""
    estimate: Floats
    """Estimated values [unit], finite, shape (n,); of vectors (n, 3)."""
    reference: Floats
    """Recorded values [unit], finite, of the shape of ``estimate``."""
    angle: Floats
    """Angle over which the channel is plotted [angle_unit], NaN where unknown, shape (n,)."""
    angle_name: str
    """Name of the joint or motor to which ``angle`` belongs; empty if there is none."""
    dropped: Mapping[str, int] = field(default_factory=dict)
    """Number of reference samples left out, by cause (a key of DROP_CAUSES)."""
    stddev: Floats | None = None
    """Standard deviation of ``estimate`` [unit], NaN where unknown, shape (n,); or None."""
    angle_unit: str = "rad"
    """Unit of ``angle``: "rad", or "m" for a prismatic joint."""

    @property
    def is_vector(self) -> bool:
        """Whether every value is a vector."""
        return self.estimate.ndim == 2

    @property
    def error_size(self) -> Floats:
        """Absolute value or norm of estimate minus reference [unit], shape (n,)."""
        return size_of(self.estimate - self.reference)


@dataclass(frozen=True, eq=False)
class BagComparison:
    """Comparison of the estimates with all references of one recording."""

    path: str
    """The recording, as the user named it."""
    duration_s: float
    """Length of the recording [s]."""
    channels: tuple[Channel, ...]
    """The compared quantities, in the order in which the robot lists them."""
    counters: Mapping[str, int] = field(default_factory=dict)
    """Number of samples refused or left out, by cause."""
    notes: tuple[str, ...] = ()
    """Remarks for the reader, one sentence or more each."""
    facts: Mapping[str, str] = field(default_factory=dict)
    """Further facts as text, by label: rate achieved, latency, versions."""
    friction: tuple[PulleyFriction, ...] = ()
    """Estimated friction at the pulleys; empty if it was not kept."""
    health: Verdict | None = None
    """What the sensors say about the robot; None if none was heard or asked."""
    judged: int = 0
    """Number of estimated tensions with a standard deviation."""
    ok: int = 0
    """Number of those of status OK."""

    @property
    def compared(self) -> bool:
        """Whether any reference value has an estimate beside it."""
        return any(len(channel.stamp_ns) for channel in self.channels)


@dataclass(frozen=True, eq=False)
class Angle:
    """The recorded angle of a motor or joint, for drawing a channel over it."""

    name: str
    """Name of the motor or joint."""
    stamp_ns: Stamps
    """Stamps [ns], strictly increasing, shape (k,)."""
    value: Floats
    """Angle [unit], shape (k,)."""
    unit: str = "rad"
    """Unit of ``value``: "rad", or "m" for a prismatic joint."""


def plot_angles(model: Model, segment: Samples) -> dict[str, Angle]:
    """Angle over which each channel is plotted, by channel name.

    A tension or nodal force is plotted over the joint that changes the length of its cable most, or
    over the cable's motor if no joint does.  An effort is plotted over its own motor or joint, but
    a motor's effort over the joint if the robot has only one.
    """
    layout, robot = model.layout, model.robot
    segment = segment.filled(robot)
    sliding = robot.prismatic_joints
    angles = {
        name: Angle(name, segment.stamp_ns, values[:, k], "m" if name in sliding else "rad")
        for names, values in (
            (layout.motors, segment.motor_angle),
            (layout.joints, segment.joint_angle),
        )
        for k, name in enumerate(names)
    }
    lowest = np.min(segment.joint_angle, axis=0)
    middle = 0.5 * (lowest + np.max(segment.joint_angle, axis=0))
    moves = np.abs(shape_at(model, middle).lever_arm)
    reach = moves * (np.max(segment.joint_angle, axis=0) - lowest)
    by_cable = {}
    for cable, part in zip(robot.cables, robot.parts, strict=True):
        along = reach[part].sum(axis=0)
        if along.size and along.max() > 0.0:
            by_cable[cable.name] = angles[layout.joints[int(along.argmax())]]
        elif cable.motors:
            by_cable[cable.name] = angles[cable.motors[0]]
        elif layout.joints:
            by_cable[cable.name] = angles[layout.joints[0]]
    chosen = {f"{EFFORT}/{name}": angle for name, angle in angles.items()}
    for prefix, names in (
        (TENSION, layout.elements),
        (NODAL_FORCE, layout.pulleys),
        (FORCE_VECTOR, layout.pulleys),
    ):
        for name in names:
            cable_name = name.rpartition("/")[0]
            if cable_name in by_cable:
                chosen[f"{prefix}/{name}"] = by_cable[cable_name]
    if len(layout.joints) == 1:  # the hysteresis loop is clearest over the joint angle
        chosen |= {f"{EFFORT}/{name}": angles[layout.joints[0]] for name in layout.motors}
    return chosen
