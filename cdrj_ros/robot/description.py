"""The parsed robot: frozen values, validated by ``cdrj_ros.robot.reader``. SI units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import hypot, inf, pi
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdrj_ros.robot.space import Frame, Place, Visual


@dataclass(frozen=True)
class FrictionLaw:
    """The constants of a law, which is in ``core/friction.hpp``, that have an effect."""

    sliding: bool = True
    """Sliding friction ``mu_c``; without it there is no friction at all."""
    static: bool = True
    """Static friction ``mu_s`` and how it fades with the slip speed."""
    bearing: bool = True
    """Friction of bearings: ``rho``, ``bearing_friction`` and ``bearing_torque``."""
    bristles: bool = True
    """Pre-sliding and viscous friction; otherwise the contact is rigid."""


LIMITING_CASES: Final[Mapping[str, FrictionLaw]] = MappingProxyType(
    {
        "none": FrictionLaw(sliding=False, static=False, bearing=False, bristles=False),
        "euler": FrictionLaw(static=False, bearing=False, bristles=False),
        "steady": FrictionLaw(bristles=False),
    }
)
"""The laws that do not take all constants, whose others have their neutral values."""


def friction_law(name: str) -> FrictionLaw:
    """What the law of this name in a robot file takes, see docs/model.md, section 4."""
    return LIMITING_CASES.get(name, FrictionLaw())


StribeckForm = Literal["printed", "capstan"]
"""Forms of static friction."""

MovingEnd = Literal["before", "after", "both"]
"""End of an arc that moves on its pulley as the wrap changes: that nearer the first node, or the
last node, or both by half of the change."""

Tracking = Literal["fixed", "adaptive"]
"""Bandwidth of the filter between counts: that of the file, or at least that."""

TABLE_INTERVALS: Final = 256
"""Intervals of a tabulated function over its joint's range."""


@dataclass(frozen=True)
class Sensor:
    """Conversion of an angle sensor's readings, angle = scale * reading + offset, and its accuracy.

    Its clock may have an offset from the other clocks, and its reading may wrap around.
    """

    scale: float = 1.0
    """Angle per unit of the reading [rad]; negative if the sensor counts in the opposite
    direction."""
    offset: float = 0.0
    """Angle at reading 0 [rad]."""
    period: float = float("inf")
    """Amount after which the reading wraps around, in its unit."""
    clock_offset_ns: int = 0
    """Added to the stamps of its readings [ns]."""
    resolution: float = 0.0
    """Size of a count, in the unit of the reading."""
    noise: float = 0.0
    """Standard deviation of a reading, in addition to quantisation, in its unit."""
    tracking_bandwidth: float = 0.0
    """Bandwidth of the filter that estimates the angle between counts [Hz]; 0 for no filter."""
    tracking: Tracking = "fixed"
    """Whether that bandwidth is fixed or rises with the motion."""
    corrected_at: tuple[float, ...] = ()
    """Angles at which ``correction`` is given, increasing [rad]; empty for no correction."""
    correction: tuple[float, ...] = ()
    """Correction added to the angle; interpolated linearly, constant beyond the ends [rad]."""


@dataclass(frozen=True)
class PassiveTorque:
    """Passive torque of an axis, in addition to that of the cables: (E13) in docs/model.md."""

    bearing_torque: float = 0.0
    """Coulomb friction torque [N m]."""
    bearing_stiffness: float = 0.0
    """Slope of the friction torque after a reversal [N m/rad]; positive if there is friction."""
    spring_stiffness: float = 0.0
    """Stiffness of the spring [N m/rad]."""
    spring_rest: float = 0.0
    """Angle at which the spring's torque vanishes [rad]."""


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of parameters of the robot file."""

    parameters: tuple[str, ...]
    """Paths, see ``cdrj_ros.robot.parameters``, length p."""
    covariance: NDArray[np.float64]
    """Covariance of the parameters in SI, symmetric and positive semidefinite, shape (p, p)."""
    stated: int = 0
    """Number of leading parameters that the file states; the others have default values."""
    may_slip: tuple[str, ...] = ()
    """Cables that may slip on their drums, by name, see docs/estimation.md."""
    model_error: tuple[tuple[str, float], ...] = ()
    """Standard deviation of the error of the model itself, by channel: ``effort/NAME`` [N m] or
    ``tension/CABLE/ELEMENT`` [N]."""

    @property
    def stddev(self) -> dict[str, float]:
        """Standard deviations by path [SI]."""
        deviations = np.sqrt(np.diag(self.covariance)).tolist()
        return dict(zip(self.parameters, deviations, strict=True))


@dataclass(frozen=True)
class Residual:
    """A learned correction of one output on top of the model, (R1) in docs/model.md."""

    output: str
    """Its channel: ``effort/NAME`` or ``tension/CABLE/ELEMENT``."""
    bound: float
    """Largest correction [N] or [N m]."""
    stddev: float
    """Standard deviation of the error that is left within the ranges [N] or [N m]."""
    inputs: Mapping[str, tuple[float, float]]
    """Lowest and highest value that was seen: of the output without correction, then of the angles
    of motors and joints, by name."""
    weights: NDArray[np.float64]
    """Of all rows and columns of (R1) [N] or [N m], see ``residual_shape``."""


RESIDUAL_ROWS: Final = 5
"""Rows of the weights for every input: itself, three stop operators and its last motion."""


def residual_shape(inputs: int) -> tuple[int, int]:
    """Rows and columns of the weights of a correction with this many inputs."""
    return RESIDUAL_ROWS * inputs, 1 + inputs


@dataclass(frozen=True)
class MovingAxis:
    """What motors and joints have in common; of a prismatic joint m stands for rad, N for N m."""

    name: str
    reference_angle: float = 0.0
    """Angle in the pose in which the preload was measured, of a joint within its range [rad]."""
    max_speed: float = float("inf")
    """Faster readings are refused [rad/s]."""
    effort_sign: int = 1
    """+1: efforts are those of the cables on the axis; -1: those that balance them."""
    effort_scale: float = 1.0
    """Effort per unit of the published effort [N m]; not 0."""
    effort_verified: bool = False
    """Whether its efforts were compared with a known load."""
    passive: PassiveTorque = PassiveTorque()
    sensor: Sensor = Sensor()


@dataclass(frozen=True)
class Motor(MovingAxis):
    """A motor whose encoder is read; its drums are winch nodes of cables."""

    effort_noise: float = 0.01
    """Standard deviation of measured efforts [N m]."""


@dataclass(frozen=True, kw_only=True)
class Joint(MovingAxis):
    """A joint, whose angle is measured or estimated from the efforts of the motors."""

    lower: float
    """Lower end of the range [rad]."""
    upper: float
    """Upper end of the range [rad]."""
    effort_noise: float | None = None
    """Standard deviation of measured efforts [N m]; None: they are not used."""
    measured: bool = True
    """Whether it has an encoder."""
    load_drift: float = 0.0
    """Standard deviation of the change of its load within 1 s [N m], of a joint without encoder;
    0: nothing is known of the load."""


@dataclass(frozen=True)
class Friction:
    """Friction of a pulley, Table II of the source; see docs/model.md, section 4."""

    mu_c: float = 0.0
    """Coulomb coefficient of cable on pulley [-]."""
    mu_s: float = 0.0
    """Static coefficient of cable on pulley [-], at least mu_c."""
    stribeck_speed: float | None = None
    """v_s [m/s]; no default, because published values differ by orders of magnitude."""
    stribeck_lag: float = 0.02
    """Time constant with which static friction follows the slip speed [s], positive."""
    rho: float = 1.0
    """Share of sliding friction in the blend; the bearing's share is 1 - rho [-]."""
    bearing_friction: float = 0.0
    """f_d of (39) [-]: half of the usual bearing coefficient."""
    bristle_stiffness: float = 1e6
    """sigma0 [N/m]."""
    bristle_damping: float = 0.0
    """sigma1 [N s/m], decreasing with speed."""
    viscous: float = 0.0
    """sigma2 [N s/m]."""
    breakaway: float = 1.0
    """Share of the bound up to which pre-sliding is elastic (law elastoplastic) [-]."""
    stribeck: StribeckForm = "printed"
    """Form of static friction: (35) as printed, or the capstan equation."""


@dataclass(frozen=True)
class Profile:
    """A function of one joint angle, tabulated on a uniform grid, or a constant."""

    joint: str | None
    angle: NDArray[np.float64]
    """Grid over the joint's range [rad], uniform, shape (k + 1,); empty for a constant."""
    value: NDArray[np.float64]
    """Values on the grid [m] or [rad]; one value for a constant."""
    slope: NDArray[np.float64]
    """Derivatives on the grid; empty for a constant."""


@dataclass(frozen=True)
class Winch:
    """A drum at an end of a cable."""

    motors: tuple[tuple[str, float], ...]
    """Motors that turn it, each with the drum's turn per turn of the motor [-]."""
    radius: float
    """From the axis to the cable's centre line [m]."""
    winding: int
    """+1: a positive angle of the drum winds the cable in; -1: pays it out."""
    place: Place | None = None
    pitch: float = 0.0
    """Distance by which the point of departure moves along the axis per turn wound in [m]."""

    @property
    def lead(self) -> float:
        """``pitch`` per radian [m/rad]."""
        return self.pitch / (2.0 * pi)

    @property
    def effective_radius(self) -> float:
        """Cable that the drum takes up per radian [m/rad]: the length of its helix."""
        return hypot(self.radius, self.lead)


@dataclass(frozen=True)
class Pulley:
    """A pulley inside a cable, or whatever else guides it there."""

    radius: float
    """From the axis to the cable's centre line [m]; 0 for an eyelet or a sheath."""
    friction: Friction
    bearing_diameter: float = 0.0
    """d of (39) [m]."""
    bearing_torque: float = 0.0
    """Load-independent friction torque of the bearing [N m]."""
    wrap: tuple[Profile, ...] = ()
    """Wrap angle [rad] as a sum of functions; empty for pulleys described by positions."""
    place: Place | None = None
    cells: int = 0
    """Number of equal contact cells, each with friction of its own; 0 lets
    ``cdrj_ros.model.laws`` choose it."""
    cell_width: float = 0.0
    """Width of contact cells that are fixed to the surface [m], of which ``cells`` are at hand; 0
    for cells that are equal parts of the arc.  Only the simulated rig sets it."""
    moving_end: MovingEnd = "both"
    """End of the arc that moves as ``wrap`` changes; without meaning where positions give the wrap.
    The middle of the arc moves towards the last node by 1/2 (after), 0 (both) or -1/2 (before) of
    radius times the change."""

    @property
    def kind(self) -> str:
        """What it is, for people: ``pulley``, ``eyelet``, ``cylinder``."""
        if self.place is None:
            return "pulley"
        return "eyelet" if self.place.kind == "point" else self.place.kind


@dataclass(frozen=True)
class Anchor:
    """A fixed end of a cable; with a radius, a sector that winds cable as its frame turns."""

    radius: float = 0.0
    """Radius of the sector [m]; 0 for a point."""
    place: Place | None = None


Node = Winch | Pulley | Anchor

MOST_PRELOADS: Final = 4.0
"""Tension that a cable without ``max_tension`` may have, in preloads."""

LARGEST_STRAIN: Final = 0.01
"""Strain that a cable with neither may have: steel breaks at 1 to 2 %."""


def turns_of(node: Node) -> dict[str, float]:
    """Angle that a node winds in per angle of every motor that turns it, (E3); empty without."""
    if not isinstance(node, Winch):
        return {}
    return {motor: node.winding * share for motor, share in node.motors}


@dataclass(frozen=True)
class Cable:
    """A chain of nodes; element i lies between nodes i and i + 1."""

    name: str
    axial_stiffness: float
    """EA [N]."""
    preload: float
    """Tension in the reference pose, the same in every element [N]; of a passive cable, 0 before
    ``prepare`` computes it."""
    nodes: tuple[Node, ...]
    spans: tuple[tuple[Profile, ...], ...] = ()
    """Length between tangent points of every element [m]; empty for cables given by positions."""
    maximum_tension: float = float("inf")
    """Tension above which an element is reported as overloaded [N]."""
    slack_tension: float = 0.1
    """Tension at or below which an element is reported as slack [N]."""
    sensor_noise: float = 0.1
    """Standard deviation of a load cell whose messages do not contain one [N]."""
    sensor_verified: bool = False
    """Whether its load cells were compared with a known load."""
    law: str = "elastoplastic"
    """Friction law of all its pulleys, by its name in the robot file."""
    bedding_strain: float = 0.0
    """Strain that the bedding of its strands adds to T / EA at high load [-]; 0: linear."""
    bedding_tension: float = 1.0
    """Tension at which half of that strain is taken up [N]."""
    creep_share: float = 0.0
    """Delayed strain under constant load as a share of the elastic strain [-], (E24); 0: none."""
    creep_time: float = 1.0
    """Time constant of the delayed strain at constant load [s]."""
    flow_time: float = float("inf")
    """Time in which the flow under constant load equals the elastic strain [s]."""
    rest_length: float = 0.0
    """Length without tension of a passive cable [m]; 0 where it follows from the preload."""

    @property
    def motors(self) -> tuple[str, ...]:
        """Names of the motors that wind it, in the order of its nodes."""
        return tuple(dict.fromkeys(name for node in self.nodes for name in turns_of(node)))

    @property
    def profiles(self) -> Iterator[Profile]:
        """All functions of joint angles whose sums are its spans and wraps."""
        return (one for own in (*self.spans, *(p.wrap for p in self.pulleys)) for one in own)

    @property
    def pulleys(self) -> tuple[Pulley, ...]:
        """The pulleys in order."""
        return tuple(node for node in self.nodes if isinstance(node, Pulley))

    @property
    def credible_tension(self) -> float:
        """Tension beyond which a motor's cable is rather misread than loaded [N].

        Infinite for a cable with a ``max_tension``, beyond which it is overloaded.
        """
        if self.maximum_tension < inf or not self.motors:
            return inf
        return max(MOST_PRELOADS * self.preload, LARGEST_STRAIN * self.axial_stiffness)

    @property
    def placed(self) -> bool:
        """Whether lengths and wrap angles are computed from positions.

        Its forces are then in the base frame.
        """
        return self.nodes[0].place is not None

    @property
    def element_names(self) -> tuple[str, ...]:
        """``cable/1`` to ``cable/n-1``."""
        return tuple(f"{self.name}/{i}" for i in range(1, len(self.nodes)))

    @property
    def pulley_names(self) -> tuple[str, ...]:
        """``cable/2`` to ``cable/n-1``: a pulley has the number of its node."""
        return tuple(f"{self.name}/{i}" for i in range(2, len(self.nodes)))


@dataclass(frozen=True)
class Robot:
    """All parameters of a robot that the estimator uses."""

    name: str
    motors: tuple[Motor, ...]
    joints: tuple[Joint, ...]
    cables: tuple[Cable, ...]
    frames: tuple[Frame, ...] = ()
    """Parents first; empty where no cable is described by positions."""
    source: str = ""
    """The file it was read from."""
    uncertainty: Uncertainty | None = None
    document: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """The file's document in SI; empty for robots that were not read from a file."""
    planar: bool = True
    """Whether the file describes it in the plane, or by tables alone."""
    base_link: str = "base"
    """Name in tf of the frame ``base``, in which positions and forces are given."""
    visuals: tuple[Visual, ...] = ()
    """Shapes of bodies, drawn behind the cables."""
    residuals: tuple[Residual, ...] = ()
    """Learned corrections, at most one of each output."""

    @property
    def prismatic_joints(self) -> frozenset[str]:
        """Names of the joints whose readings are positions [m] instead of angles."""
        return frozenset(
            frame.joint
            for frame in self.frames
            if frame.motion == "prismatic" and frame.joint and not frame.coupled
        )

    def unit_of(self, axis: str) -> str:
        """Unit of the angle of a motor or joint, or of its position."""
        return "m" if axis in self.prismatic_joints else "rad"

    @property
    def axes(self) -> tuple[Motor | Joint, ...]:
        """All motors, followed by all joints."""
        return (*self.motors, *self.joints)

    @property
    def reference_pose(self) -> NDArray[np.float64]:
        """Angles of all joints in the pose in which the preload was measured, shape (joints,)."""
        return np.array([joint.reference_angle for joint in self.joints], dtype=np.float64)

    @property
    def reference_motors(self) -> NDArray[np.float64]:
        """Angles of all motors in that pose [rad], shape (motors,)."""
        return np.array([motor.reference_angle for motor in self.motors], dtype=np.float64)

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """For every cable, the slice of its elements among those of all cables."""
        ends = np.cumsum([0, *(len(cable.nodes) - 1 for cable in self.cables)]).tolist()
        return tuple(map(slice, ends, ends[1:]))

    def per_element(self, values: ArrayLike) -> NDArray[Any]:
        """One value or row for every element, from those of the cables."""
        return np.repeat(values, [len(cable.nodes) - 1 for cable in self.cables], axis=0)

    @cached_property
    def effective_radii(self) -> NDArray[np.float64]:
        """Cable that every motor winds in per radian [m], shape (cables, motors); read-only."""
        radii = np.zeros((len(self.cables), len(self.motors)))
        names = [motor.name for motor in self.motors]
        for c, cable in enumerate(self.cables):
            for node in (one for one in cable.nodes if isinstance(one, Winch)):
                for motor, turn in turns_of(node).items():
                    radii[c, names.index(motor)] += turn * node.effective_radius
        radii.flags.writeable = False
        return radii

    @property
    def effort_scale(self) -> dict[str, float]:
        """Effort per unit of the published effort, of every motor and joint."""
        return {axis.name: axis.effort_scale for axis in self.axes}

    @property
    def offsets(self) -> tuple[float, ...]:
        """Offsets of the sensors of all axes [rad]."""
        return tuple(axis.sensor.offset for axis in self.axes)

    @property
    def unmeasured(self) -> tuple[int, ...]:
        """Indices of the joints without encoder."""
        return tuple(j for j, joint in enumerate(self.joints) if not joint.measured)

    @property
    def as_read(self) -> Robot:
        """The robot with only those joints that have encoders, for the conditioning of readings."""
        if not self.unmeasured:
            return self
        return replace(self, joints=tuple(joint for joint in self.joints if joint.measured))
