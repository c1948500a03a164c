"""The step of every sample and all that runs with it, in C++: the module `cdrj_ros._core`.

Angles are in rad (in m for a sliding axis), stamps in ns since the clock's epoch.
"""

from collections.abc import Sequence
from enum import Enum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

ALL_SEEN: Final[NDArray[np.float64]]
"""What samples without deviations have as ``unseen``; shape (0, 0)."""
NONE_CHANGED: Final[NDArray[np.float64]]
"""What samples have as ``offset`` where it is that of the sample before; shape (0, 0)."""
END_OF_TIME_NS: Final[int]
"""The stamp of a header, whose seconds have 32 bits with a sign, is below this [ns]."""
MAX_GAP_NS: Final[int]
"""A stamp further than this from the last one needs confirmation by later readings [ns]."""
CONFIRMATIONS: Final[int]
"""A jump of the clock is accepted only after this many consistent readings."""
RANGE_MARGIN: Final[float]
"""Tolerance for rounding at the ends of a joint's range [rad]."""
LARGEST: Final[float]
"""Bound on the magnitude of any reading [rad]."""
WAITING: Final[int]
"""Greatest number of readings that a channel keeps for another channel."""

class JointStateDecoder:
    """Decodes JointState messages of one topic; its properties are those of the last good one."""

    def __init__(self, efforts: bool = False) -> None:
        """Start without a message.

        Args:
            efforts: whether messages with efforts for only some of their names are malformed.
        """

    def decode(self, payload: bytes, arrival_ns: int = -1) -> bool:
        """Decode a message in plain CDR; False if it is malformed, which changes nothing.

        Args:
            payload: the message.
            arrival_ns: when it arrived [ns], which replaces a stamp of zero.
        """

    @property
    def stamp_ns(self) -> int: ...
    @property
    def by_arrival(self) -> bool:
        """Whether the stamp is the time of arrival, because the header's is zero."""

    @property
    def has_efforts(self) -> bool: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def positions(self) -> NDArray[np.float64]:
        """[rad], one per name."""

    @property
    def efforts(self) -> NDArray[np.float64]:
        """[N m]; empty if the message has none."""

class MessageEncoder:
    """A message whose names and array sizes stay the same, in plain CDR, little-endian."""

    def __init__(
        self,
        blank: bytes,
        values: Sequence[tuple[int, int, int]],
        stddevs: Sequence[tuple[int, int, int]],
        flags: Sequence[tuple[int, int, int]],
    ) -> None:
        """Prepare the message.

        Args:
            blank: the message with any numbers.
            values: which numbers are copied from the values: offset of the first one in the
                message [bytes], its index among the values, their count.
            stddevs: the same for the standard deviations.
            flags: bytes of status: offset in the message [bytes], then the indices of two values,
                which may be the same, whose flags it unites.

        Raises:
            IndexError: a field is outside of the message.
        """

    def encode(
        self, stamp_ns: int, values: NDArray[np.float64], stddevs: NDArray[np.float64]
    ) -> bytes:
        """Encode the message with this stamp and these numbers.

        Raises:
            ValueError: a stamp that no header can hold, or fewer numbers than are copied.
        """

Guide: Final[type[Enum]]
"""What a cable given by positions touches, by the kinds of ``cdrj_ros.robot.space``."""
FrameMotion: Final[type[Enum]]
"""Motion of a frame relative to its parent, by the words of a robot file."""
Law: Final[type[Enum]]
"""Friction laws, by the words of a robot file."""
RECORDS: dict[str, list[tuple[str, str]]]
"""Fields of the records of ``robot_records.hpp`` with NumPy's types."""

class Stribeck(Enum):
    """How static friction enters: (35) as printed, or the capstan equation with mu_s."""

    printed = 0
    capstan = 1

class Topic(Enum):
    """What a topic carries."""

    MOTORS = 0
    JOINTS = 1
    BOTH = 2

class Axis:
    """A motor or joint: how readings become angles, and what these must satisfy."""

    def __init__(
        self,
        name: str,
        *,
        lower: float,
        upper: float,
        max_speed: float,
        clock_offset_ns: int,
        clock_stddev: float,
        period: float,
        scale: float,
        offset: float,
        corrected_at: Sequence[float],
        correction: Sequence[float],
        bandwidth: float,
        adaptive: bool,
        band: float,
        negligible: float,
        worth: float,
        pull: Sequence[float],
        start: float,
    ) -> None:
        """Keep the numbers.

        Args:
            name: in messages.
            lower, upper: range of the angle [rad].
            max_speed: [rad/s].
            clock_offset_ns: added to stamps [ns].
            clock_stddev: its standard deviation [s].
            period: after which the reading wraps around [rad]; infinite if it does not.
            scale, offset: angle = scale * unwrapped reading + offset [rad].
            corrected_at, correction: angles, and what is added there [rad].
            bandwidth: of the filter between counts [Hz]; 0 for none.
            adaptive: whether that bandwidth rises with the motion.
            band: greatest difference of an angle and its reading [rad].
            negligible: standard deviations up to this are not reported [rad].
            worth: change of the angle that alone makes tensions ``UNSURE`` [rad].
            pull: of every cable, see ``conditioner.pulls_of`` [1/rad]; empty for none.
            start: an ambiguous first reading means the possible angle nearest to it [rad].
        """

    @property
    def name(self) -> str: ...
    @property
    def lower(self) -> float: ...
    @property
    def upper(self) -> float: ...
    @property
    def clock_offset_ns(self) -> int: ...
    @property
    def bandwidth(self) -> float: ...
    @property
    def adaptive(self) -> bool: ...
    def angles_of(self, readings: NDArray[np.float64]) -> NDArray[np.float64]:
        """Angles of readings of a whole recording, acceptable or not; NaN beyond ``LARGEST``."""

    def angle_near(self, reading: float, near: float) -> float:
        """Angle of a single reading; of those that it may mean, that in range nearest ``near``."""

class Conditioner:
    """Gates and time line of one robot."""

    def __init__(
        self, axes: Sequence[Axis], motors: int, predict: bool, horizon_ns: int
    ) -> None: ...
    def feed(
        self,
        topic: Topic,
        stamp_ns: int,
        names: Sequence[str],
        positions: Sequence[float] | NDArray[np.float64],
        arrival_ns: int = -1,
        by_arrival: bool = False,
    ) -> list[tuple[Any, ...]]:
        """Take a message; returns the fields of every ``Sample`` that is now complete."""

    def feed_message(self, topic: Topic, message: JointStateDecoder) -> list[tuple[Any, ...]]:
        """``feed`` the last message that was decoded."""

    def refuse(self, cause: str) -> None:
        """Count a message that is refused whole, by a cause of ``refused``."""

    def take_refused(self) -> dict[str, dict[str, float]]:
        """Largest reading refused since the last call, by axis and cause.

        It is the time by which it is late (negative) or ahead of the last accepted one [s], the
        angle where it is out of range [rad], the speed that an implausible one needs [rad/s], or 0.
        """

    def reset(self, keep_turns: bool = False) -> None:
        """Forget all readings; the counters stay.

        Args:
            keep_turns: keep the motion estimates of the axes and the count of turns of every sensor
                with a ``period``.  Otherwise only the count is kept, and only if the next reading
                follows within ``MAX_GAP_NS``.
        """

    def remembered(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Numbers that outlast a restart, shapes (axes, 8) and (axes,)."""

    def remember(self, rows: NDArray[np.float64], stepped: NDArray[np.float64]) -> None:
        """Restore what ``remembered`` gave, before the first reading."""

    def continue_from(self, angles: NDArray[np.float64], stamp_ns: int) -> None:
        """Continue from the last sample of an earlier run, angles of shape (axes,) [rad]."""

    def use_tracking_of(self, axes: Sequence[Axis]) -> None:
        """Change the tracking bandwidths to those of ``axes``; no reading is lost."""

    @property
    def refused(self) -> dict[str, int]: ...
    @property
    def accepted(self) -> int: ...
    @property
    def elsewhere(self) -> int: ...
    @property
    def clock_jumps(self) -> int: ...
    @property
    def gaps(self) -> int: ...
    @property
    def steps(self) -> int: ...
    @property
    def crowded(self) -> int: ...
    @property
    def lag_ns(self) -> int: ...
    @property
    def held(self) -> int: ...
    @property
    def unheard(self) -> list[str]: ...
    @property
    def ahead(self) -> dict[str, int]:
        """Stamp of the last reading, less its time of arrival if that is known [ns], by name."""

    @property
    def displaced(self) -> dict[str, float]: ...
    @property
    def alternating(self) -> list[str]: ...
    @property
    def stuck(self) -> list[str]: ...
    @property
    def misfitting(self) -> list[str]: ...
    @property
    def lagging(self) -> dict[str, tuple[int, float]]:
        """Least lag behind the others [ns], and its growth, of axes where this counts, by name."""

    @property
    def held_of(self) -> dict[str, list[tuple[int, float]]]:
        """Stamps [ns] and readings [rad] held after a possible jump of the clock, by name."""

    @property
    def waiting(self) -> dict[str, int]:
        """Number of readings kept for later samples and for the velocity, by name."""

class Recording:
    """Readings of a recording, fed to a conditioner in order of arrival."""

    def __init__(
        self,
        conditioner: Conditioner,
        series: Sequence[
            tuple[Topic, str, NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], bool]
        ],
    ) -> None:
        """Prepare.

        Args:
            conditioner: takes the readings.
            series: topic, name, stamps [ns], times of arrival [ns] and readings [rad] of channels.
        """

    @property
    def is_over(self) -> bool: ...
    def advance(
        self, most: int
    ) -> list[
        tuple[
            bool,
            NDArray[np.int64],
            NDArray[np.float64],
            NDArray[np.float64],
            NDArray[np.uint64],
            NDArray[np.float64],
            NDArray[np.uint64],
            NDArray[np.float64],
            NDArray[np.uint64],
        ]
    ]:
        """Take up to ``most`` readings.

        Returns:
            One piece of samples, and a further one after every jump of the clock: whether the clock
            went back before it; stamps [ns], shape (n,); angles of motors and of joints [rad],
            shapes (n, motors) and (n, joints); rows that have ``unseen``, and these,
            shape (rows, 2, axes); rows that have ``offset``, and these, shape (rows, 3, axes); rows
            that are doubtful.
        """

class TrackingFilter:
    """A filter of the angle between the counts of a sensor, (C1) of docs/estimation.md."""

    def __init__(self) -> None: ...
    def track(
        self, since_ns: int, reading: float, bandwidth: float, band: float, adaptive: bool
    ) -> float:
        """The angle at a reading [rad], within ``band`` of it.

        Args:
            since_ns: time since the reading before [ns]; ignored at the first one.
            reading: angle by the sensor [rad].
            bandwidth: of the filter [Hz], positive.
            band: greatest difference of angle and reading [rad].
            adaptive: whether the bandwidth rises with the motion, (C6).
        """

    @property
    def moves(self) -> bool:
        """Whether an adaptive filter sees the axis move."""

MOVED: Final[float]
"""If an axis moves further than this in a gap, the friction history is unknown [rad]."""

class Population:
    """Robots of one topology, each with constants and a history of its own."""

    def __init__(self, robot: Robot, constants: NDArray[np.float64]) -> None:
        """Copy all arrays.

        Args:
            robot: whose topology they have.
            constants: of every robot, shape (robots, constants).

        Raises:
            TypeError: an array is not contiguous or of another type.
            ValueError: the constants are not those of such robots.
        """

    def advance(
        self,
        k: int,
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        dt: float,
    ) -> tuple[bool, NDArray[np.float64]]:
        """``Robot.step`` of robot ``k`` from its own state, which changes: (solved, estimate)."""

    def reset(self) -> None:
        """Discard the history of all robots."""

class Ensemble:
    """Robots that differ in all that is unknown, stepped along with the estimate.

    Where not stated otherwise, functions take samples as ``Sample`` holds them, in any layout, and
    raise ValueError if an array is of another robot.
    """

    def __init__(
        self,
        robot: Robot,
        constants: NDArray[np.float64],
        friction_share: NDArray[np.float64],
        slipping: NDArray[np.bool_],
        effort_error: NDArray[np.float64],
        reading_error: NDArray[np.float64],
        zero_error: NDArray[np.float64],
        unseen_share: NDArray[np.float64],
        offset_gain: NDArray[np.float64],
        length_share: NDArray[np.float64],
        span: NDArray[np.float64],
        unmodelled: NDArray[np.float64],
    ) -> None:
        """Copy all arrays.

        Args:
            robot: of the estimate.
            constants: of every member, shape (members, constants).
            friction_share: initial friction as a share of its bound, shape (members, pulleys).
            slipping: whether a member's cables slip on their drums, shape (members,).
            effort_error: lasting errors of the efforts [N m], shape (members, motors).
            reading_error: rows used in turn [rad], shape (rows, axes).
            zero_error: of every member's zeros [rad], shape (members, axes).
            unseen_share: xi of (U3), rows used in turn, shape (rows, members, axes).
            offset_gain: change per offset of an axis (U12), shape (quantities, axes).
            length_share: of every element in the length of its cable, shape (elements,).
            span: range of all axes [rad], shape (2, axes).
            unmodelled: variance that no member shows, (U5), and magnitude where cables are slack,
                (U6), shape (2, quantities).

        Raises:
            TypeError: an array is not contiguous or of another type.
            ValueError: an array has not the shape of this robot's ensemble.
        """

    def step(
        self,
        before: State,
        stamp_ns: int,
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        unseen: NDArray[np.float64],
        offset: NDArray[np.float64],
    ) -> tuple[State, NDArray[np.float64], bool, NDArray[np.float64]]:
        """``Robot.step`` and ``update``: (state, estimate, solved, standard deviations)."""

    def update(
        self,
        stamp_ns: int,
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        unseen: NDArray[np.float64],
        offset: NDArray[np.float64],
        estimate: NDArray[np.float64],
        least: int,
    ) -> NDArray[np.float64]:
        """The standard deviations at a sample and its estimate, shape (quantities,).

        They are those before the update of the member in turn.

        Args:
            stamp_ns, motor_angle, joint_angle, unseen, offset: the sample.
            estimate: shape (estimate_size,).
            least: number of members that are updated at least.
        """

    def predict(
        self,
        stamp_ns: int,
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        unseen: NDArray[np.float64],
        offset: NDArray[np.float64],
        estimate: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """``update`` at a predicted sample, which the ensemble forgets at the next other one."""

    def follow(
        self,
        stamp_ns: NDArray[np.int64],
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        unseen: NDArray[np.float64],
        offset_rows: NDArray[np.int64],
        offset: NDArray[np.float64],
        estimates: NDArray[np.float64],
        stddev: NDArray[np.float64],
    ) -> None:
        """``update`` for many samples as ``Samples`` holds them, bit for bit.

        Raises:
            KeyboardInterrupt: between some thousand samples.
        """

    def roll_back(self) -> None:
        """Forget what has been predicted."""

    def continue_lags(self, before: Ensemble) -> None:
        """Continue with what another ensemble of the robot knows of lasting errors (U12), (U13)."""

    def renew_lasting(self) -> None:
        """Compute what follows from ``lags``, after changes of it."""

    def reset(self) -> None:
        """Discard the history of all members; the next sample starts them anew."""

    # views of the ensemble's memory, which may be written
    @property
    def constants(self) -> NDArray[np.float64]: ...
    @property
    def friction_share(self) -> NDArray[np.float64]: ...
    @property
    def reading_error(self) -> NDArray[np.float64]: ...
    @property
    def zero_error(self) -> NDArray[np.float64]: ...
    @property
    def states(self) -> NDArray[np.float64]:
        """Shape (members, state_size)."""

    @property
    def stamps(self) -> NDArray[np.int64]:
        """Of the last update of every member's cables [ns], shape (members, cables)."""

    @property
    def progress(self) -> NDArray[np.int64]:
        """Updates in turn so far, stamps of the last sample and of the last of them [ns] or -1."""

    @property
    def unsolved(self) -> NDArray[np.int64]:
        """1 for every cable that was not solved in the last sample, shape (cables,)."""

    @property
    def cable_steps(self) -> int:
        """Steps of all cables of all members so far: what the standard deviations have cost."""

    @property
    def angle(self) -> NDArray[np.float64]:
        """Of all axes at the last sample [rad], shape (axes,)."""

    @property
    def unseen(self) -> NDArray[np.float64]:
        """Standard deviations of these angles [rad], shape (axes,)."""

    @property
    def lag(self) -> NDArray[np.float64]:
        """Mean and standard deviation of the age of an axis's values, (U18) [s], shape (2, axes).

        It is relative to the first axis of its cables; infinite where nothing shows it.
        """

    @property
    def least_variance(self) -> NDArray[np.float64]:
        """Least variance of every quantity that is shown, (U15), shape (quantities,)."""

    @property
    def lags(self) -> NDArray[np.float64]:
        """What is remembered of mean tensions and velocities, (U13) and (U18); opaque."""

    @property
    def intervals(self) -> NDArray[np.int64]:
        """Twice the number of past intervals without readings, plus one during one, (axes,)."""

    @property
    def deviation(self) -> NDArray[np.float64]:
        """Of the members' quantities from the estimate's, shape (members, quantities)."""

    @property
    def variance(self) -> NDArray[np.float64]:
        """Mean squares of these deviations (U1), shape (quantities,)."""

def mark_unsure(
    estimates: NDArray[np.float64],
    preload: NDArray[np.float64],
    stddev: NDArray[np.float64],
    share: float,
    doubtful: NDArray[np.bool_],
) -> None:
    """Set ``UNSURE`` where standard deviations are too large for tension and preload, or in doubt.

    Args:
        estimates: tensions, then status of all elements, then the rest, shape (size,) or (n, size);
            changed.
        preload: see ``cdrj_ros.estimation.ensemble.preload_of_elements`` [N].
        stddev: of the tensions, then the rest [N], shape (columns,) or (n, columns); with a size of
            0, none is known.
        share: see ``cdrj_ros.estimation.ensemble.UNSURE_SHARE``.
        doubtful: see ``cdrj_ros.estimation.estimator.Samples.doubtful``, shape (n,) or (0,).
    """

NEVER: Final[int]
"""Stamp of a state before its first sample."""

class State:
    """History-dependent state of the cables; opaque, never changed in place."""

    def __init__(self, stamp_ns: int, values: NDArray[np.float64]) -> None:
        """The state after a sample.

        Args:
            stamp_ns: stamp of the sample [ns]; ``NEVER`` before the first.
            values: shape (state_size,), see ``cdrj_ros.model.packing``; copied.
        """

    @property
    def stamp_ns(self) -> int: ...
    @property
    def values(self) -> NDArray[np.float64]:
        """A copy, shape (state_size,)."""

class Robot:
    """A robot as ``cdrj_ros.model.packing`` packs it; it keeps its arrays alive."""

    def __init__(self, topology: NDArray[np.int64], constants: NDArray[np.float64]) -> None:
        """Take the connections of a robot's parts and their constants; neither is copied.

        Raises:
            TypeError: an array is not contiguous or of another type.
        """

    def is_state(self, numbers: NDArray[np.float64]) -> bool:
        """Whether numbers may be a state: within bounds that keep every step defined."""

    @property
    def state_size(self) -> int:
        """Numbers of a state."""

    @property
    def estimate_size(self) -> int:
        """Numbers of an estimate."""

    @property
    def scratch_size(self) -> int:
        """Numbers of the workspace."""

    def step(
        self,
        before: State,
        stamp_ns: int,
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
    ) -> tuple[State, NDArray[np.float64], bool]:
        """One sample: (state, angles) -> (state, estimate, solved).

        Args:
            before: the state; not changed.
            stamp_ns: of the sample, later than the state's [ns].
            motor_angle, joint_angle: angles [rad], of prismatic joints [m], in the robot's order.

        Returns:
            The new state, the estimate, shape (estimate_size,), and whether it is solved.  It is
            not where the geometry is impossible at these joint angles (the state is then kept) or
            some cable could not be solved; the elements concerned are ``INVALID``.

        Raises:
            TypeError: an array is not contiguous or of another type.
            ValueError: the angles or the state are not those of this robot.
        """

    def run(
        self,
        before: State,
        stamp_ns: NDArray[np.int64],
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        estimates: NDArray[np.float64],
        slipping: bool = False,
    ) -> State:
        """``step`` for many samples, bit for bit.

        Args:
            before: the state; not changed.
            stamp_ns: increasing, later than the state's [ns], shape (samples,).
            motor_angle, joint_angle: [rad] or [m], shapes (samples, motors), (samples, joints).
            estimates: shape (samples, estimate_size), written.
            slipping: whether the cables slip on their drums.

        Returns:
            The state after the last sample.

        Raises:
            TypeError, ValueError: as ``step``.
            KeyboardInterrupt: between some thousand samples.
        """

    def shape(
        self,
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        scratch: NDArray[np.float64],
    ) -> bool:
        """Geometry of all cables in a pose; False if the path of a cable is impossible.

        Args:
            motor_angle: [rad], shape (motors,), or (0,) for drums at rest.
            joint_angle: [rad] or [m], shape (joints,).
            scratch: the workspace, written.
        """

    def course(
        self,
        joint_angle: NDArray[np.float64],
        length: NDArray[np.float64],
        lever_arm: NDArray[np.float64],
        wrap: NDArray[np.float64],
        arc: NDArray[np.float64],
        track: NDArray[np.float64],
    ) -> int:
        """Geometry along a motion, see ``Course``; all shapes begin with the poses.

        Returns:
            The first impossible pose, or their number.
        """

    def start(
        self,
        motor_angle: NDArray[np.float64],
        joint_angle: NDArray[np.float64],
        share: NDArray[np.float64],
    ) -> State:
        """The state before the first sample, with a friction history.

        Args:
            motor_angle, joint_angle: as ``step``.
            share: friction as a share of every pulley's bound, in [-1, 1], shape (pulleys,).
        """

    def forget_drums(self, state: State) -> State:
        """Give all cable on the drums the present strain, as of a cable that slips on its drum."""

MINIMUM_TRANSMISSION: Final[float]
"""Floor of eta: the printed (35) goes below zero for large mu_s / mu_c and wrap angles."""
BOUND_FLOOR: Final[float]
"""epsilon of (34) [N]: keeps the bound positive on a slack cable."""

def residual_products(
    inputs: NDArray[np.float64], dt: NDArray[np.float64], ranges: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a learned correction depends on, along a motion: (R1) to (R3) in docs/model.md.

    Args:
        inputs: the output without correction [N] or [N m], then angles [rad] or [m], shape
            (n, inputs).
        dt: time since the sample before [s], shape (n,).
        ranges: lowest and highest value of every input that was seen, shape (inputs, 2).

    Returns:
        The products of all rows and columns, shape (n, weights), and the share of the correction
        that applies, shape (n,).
    """

def stribeck_share(slip_speed: float, stribeck_speed: float) -> float:
    """Share in [0, 1] of static friction that is left at a slip speed: last factor of (33)."""

def sliding_loss(
    mu_c: float, mu_s: float, wrap_angle: float, stribeck: Stribeck
) -> tuple[float, float]:
    """(34)-(37) as ``1 - eta_d = kinetic + static * stribeck_share(v)``; (kinetic, static).

    ``printed`` scales the kinetic loss by mu_s / mu_c as in (35); ``capstan`` lets the loss at
    rest be 1 - exp(-mu_s beta).
    """

def sliding_transmission(
    slip_speed: float,
    mu_c: float,
    mu_s: float,
    stribeck_speed: float,
    wrap_angle: float,
    stribeck: Stribeck,
) -> float:
    """(37): eta_d at a slip speed [m/s], kept above ``MINIMUM_TRANSMISSION``."""

def bearing_transmission(wrap_angle: float, bearing_ratio: float) -> float:
    """(41): eta_r of a pulley on a bearing; ``bearing_ratio`` = f_d d / r_p = 1 / alpha."""

def blended_loss(
    rho: float,
    mu_c: float,
    mu_s: float,
    wrap_angle: float,
    bearing_ratio: float,
    stribeck: Stribeck,
) -> tuple[float, float]:
    """(42), (43): ``1 - eta = kinetic + static * stribeck_share(v)`` of a pulley.

    The transmission is eta = rho eta_d + (1 - rho) eta_r.  Returns (kinetic, static); their sum is
    kept below 1 - ``MINIMUM_TRANSMISSION``.
    """

def cell_loss(kinetic: float, static: float, share: float) -> tuple[float, float]:
    """(E28): losses of a contact cell that has a share of its pulley's wrap."""

def friction_force(
    law: Enum, before: float, slip: float, stiffness: float, bound: float, breakaway: float
) -> tuple[float, float, float]:
    """(33), (E9): bristle force after a slip, exact over the slip for a constant bound.

    Args:
        law: code of the friction law, its place in ``cdrj_ros.robot.description.LAWS``.
        before: bristle force sigma0 z before the slip [N].
        slip: material that has moved past the body's surface [m].
        stiffness: sigma0 [N/m].
        bound: g = (1 - eta) T_pull [N], positive.
        breakaway: share of the bound up to which pre-sliding is purely elastic, in [0, 1].

    Returns:
        Force [N], its derivative by the slip [N/m] and by the bound [-].
    """

def crept(
    share: float, time: float, flow_time: float, strain: float, delayed: float, dt: float
) -> tuple[float, float]:
    """(E24) over a time in which a segment keeps its length.

    Args:
        share, time, flow_time: c, tau [s] and tau_f [s] of the cable.
        strain: elastic strain at first; negative by as much as it hangs loose [-].
        delayed: delayed strain at first [-].
        dt: the time [s].

    Returns:
        The delayed strain afterwards, and the factor by which the unstretched length has grown.
    """

def tolerance(elastic: tuple[float, float, float]) -> float:
    """Largest force imbalance of a solved contact [N]."""

def acceptable(elastic: tuple[float, float, float]) -> float:
    """Largest force imbalance of a usable sample; with a larger one it counts as unsolved [N]."""

def element_tension(elastic: tuple[float, float, float], length: float, material: float) -> float:
    """(E1), (E21): tension of a segment from its length and its material [m] [N]."""

class Drum:
    """What a winch drum holds (E3): cable comes off at the strain at which it went on."""

    def __init__(self, angle: float, material: float, rate: float) -> None:
        """Below ``angle`` [rad] the drum holds ``rate`` [m/rad]; ``material`` [m] is on it."""

    def turn(self, angle: float, rate: float) -> float:
        """Turn to a wound angle [rad], new layers at ``rate`` [m/rad]; material on it [m]."""

    @property
    def held(self) -> float:
        """Unstretched material on the drum since the reference [m]."""

    @property
    def points(self) -> int:
        """Break points in use."""

    @property
    def spacing(self) -> float:
        """Distance of break points [rad]."""

class Stepper:
    """A robot on its way along a plan; one of its joints may move freely or be balanced.

    A new one is at rest in phase 0 of the plan, and all joints follow the plan.
    """

    state: NDArray[np.float64]
    """The robot's state, shape (state_size,); a copy."""
    swing: NDArray[np.float64]
    """Angle, speed, acceleration of the free joint, and the cables' torque on it; a copy."""

    def __init__(self, robot: Robot, joint: int) -> None:
        """Start at rest; ``joint`` is the one that may move freely or be balanced."""

    @property
    def phase(self) -> int:
        """Row of the plan that is carried out."""

    def prescribe(self) -> None:
        """From now on, every joint follows the plan."""

    def release(
        self,
        load: Sequence[float] | NDArray[np.float64],
        effort_sign: float,
        lower: float,
        upper: float,
    ) -> None:
        """From now on, the joint moves by its dynamics (trapezoidal rule) within its range.

        Args:
            load: inertia, times cos q, weight, times cos q, times cos 2q, damping; SI.
            effort_sign: +1 or -1, that of its efforts.
            lower, upper: its range [rad] or [m].
        """

    def balance(
        self, direction: NDArray[np.float64], rising: float, motor_speed: float, drive: float
    ) -> None:
        """From now on, the motors turn so that the cables exert the plan's torque on the joint.

        Args:
            direction: of the motors per unit of the drive, shape (motors,).
            rising: sign of the joint's effort over the drive.
            motor_speed: largest speed of the drive; the joint waits for the motors [rad/s].
            drive: angle by which the motors are driven beyond the plan at first [rad].
        """

    def efforts(
        self, motors: NDArray[np.float64], joints: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Effort on the joint in poses without a state before [N m], shape (n,).

        Args:
            motors: angles of all motors [rad], shape (n, motors).
            joints: angles of all joints [rad] or [m], shape (n, joints).
        """

    def run(
        self,
        motors: NDArray[np.float64],
        joints: NDArray[np.float64],
        torque: NDArray[np.float64],
        dt: NDArray[np.float64],
        offset: NDArray[np.float64],
        happening: NDArray[np.bool_],
        motors_out: NDArray[np.float64],
        joints_out: NDArray[np.float64],
        imbalance: NDArray[np.float64],
        estimates: NDArray[np.float64],
    ) -> tuple[int, float]:
        """Take n samples, each of which goes on by a phase of the plan unless the joint waits.

        Args:
            motors, joints: the plan's angles [rad] or [m], one row a phase.
            torque: of every phase, wanted of the balanced or external on the free joint [N m].
            dt: time since the sample before [s], shape (n,); with 0 the phase is kept.
            offset: of the motors by faults [rad], shape (n, motors).
            happening: whether a fault happens, shape (n,).
            motors_out: angles of the motors without the offsets [rad], shape (n, motors), written.
            joints_out: angles of the joints [rad] or [m], shape (n, joints), written.
            imbalance: torque of the cables less the needed one [N m], shape (n,), written.
            estimates: shape (n, estimate_size), written.

        Returns:
            Number of samples done: fewer than n where the free joint leaves its range or no drive
            balances the joint; and the speed that this would have asked of the motors [rad/s].
        """

class EncoderlessJoint:
    """A joint without encoder, and what is known of it."""

    def __init__(
        self, *, joint: int, lower: float, upper: float, start: float, load_drift: float
    ) -> None:
        """Keep the numbers.

        Args:
            joint: its index among all joints of the robot.
            lower, upper: ends of its range [rad] or [m].
            start: angle from which the first search begins [rad] or [m].
            load_drift: standard deviation of the change of its load in 1 s [N m]; 0 where nothing
                is known of it.
        """

class EncoderlessEstimator:
    """The estimate of a robot with u joints without encoder, and its ensemble."""

    def __init__(
        self,
        *,
        ensemble: Ensemble,
        joints: Sequence[EncoderlessJoint],
        effort_noise: Sequence[float],
    ) -> None:
        """Take an ensemble, whose members this object alone advances.

        Args:
            ensemble: of the robot.
            joints: those without encoder, in the robot's order.
            effort_noise: standard deviation of the measured effort of every motor [N m].
        """

    def run(
        self,
        stamp_ns: NDArray[np.int64],
        motor_angle: NDArray[np.float64],
        measured_angle: NDArray[np.float64],
        effort: NDArray[np.float64],
        estimates: NDArray[np.float64],
        stddevs: NDArray[np.float64],
        angles: NDArray[np.float64],
        angle_stddevs: NDArray[np.float64],
    ) -> None:
        """Estimate samples, one after the other; one or many at a time give the same bits.

        Args:
            stamp_ns: shape (n,).
            motor_angle: [rad], shape (n, motors).
            measured_angle: of the joints with encoder [rad] or [m], shape (n, joints - u).
            effort: of the motors [N m], shape (n, motors); NaN where none was heard.
            estimates: shape (n, estimate_size), written.
            stddevs: shape (n, columns), written.
            angles, angle_stddevs: of the joints without encoder [rad] or [m], (n, u), written.

        Raises:
            TypeError: an array is not contiguous or of another type.
            ValueError: the arrays are not those of this robot.
            KeyboardInterrupt: between some hundred samples.
        """

    def reset(self) -> None:
        """Discard everything that was heard; the next effort starts anew."""

    def keep(self) -> None:
        """Keep the history, unless that has been done."""

    def roll_back(self) -> None:
        """Return to the history that was kept; without effect if there is none."""

    @property
    def state(self) -> NDArray[np.float64]:
        """The nominal robot's state after the last sample, shape (state_size,), a copy."""
