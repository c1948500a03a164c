"""The estimator: ``step(model, state, sample) -> (state, estimate)``.

The node, the offline validation, the identification and the benchmark all call these functions.
A run may continue from the end of an earlier one.  A sample has the readings of all motors and
joints, brought to one time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros import _core
from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.packing import INVALID, STALE, Layout, channel_columns, stddev_places
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot

ALL_SEEN: Vector = _core.ALL_SEEN
"""``Sample.unseen`` where every axis was read often enough: all deviations are zero."""

NONE_CHANGED: Vector = _core.NONE_CHANGED
"""``Sample.offset`` where it is that of the sample before."""

NO_ROWS: NDArray[np.int64] = np.empty(0, dtype=np.int64)
NO_OFFSETS: Vector = np.empty((0, 0, 0))

ALL_SEEN_OVER_TIME: Vector = np.empty((0, 0, 0))
"""``Samples.unseen`` where all deviations of all samples are zero."""

NO_DOUBTS: NDArray[np.bool_] = _core.NONE_FLAGGED
"""``Sample.doubtful`` and ``after_gap``, and those of ``Samples``, where none is."""


class Sample(NamedTuple):
    """Encoder readings of all motors and joints at one time."""

    stamp_ns: int
    """Time since the clock's epoch [ns]."""
    motor_angle: Vector
    """[rad], shape (motors,), in the robot's order; NaN where nothing is known of it."""
    joint_angle: Vector
    """[rad], shape (joints,), likewise."""
    unseen: Vector = ALL_SEEN
    """Standard deviations due to sparse readings, of motors, then joints [rad], shape (2, axes).

    Row 0: at the sample's time.  Row 1: midway between the sample before and this one; infinite
    where the motion between them is unknown.  Shape (0, 0) where all are zero.
    """
    offset: Vector = NONE_CHANGED
    """Standard deviations of lasting errors that the readings do not show, of motors, then joints
    shape (2, axes).

    Row 0: of offsets, (C9) [rad].  Row 1: of how much older their values are than the stamps, (C10)
    [s].  Shape (0, 0) where they are those of the sample before.
    """
    doubtful: NDArray[np.bool_] = NO_DOUBTS
    """Whether angles may be wrong because the readings of their sensors have stepped, of motors,
    then joints, shape (axes,); (0,) where none may be."""
    after_gap: NDArray[np.bool_] = NO_DOUBTS
    """Whether axes were not read for so long before their readings at or after this sample that
    their drivers may have started anew, likewise."""
    predicted: bool = False
    """Whether an angle is extrapolated.  The next sample that is not predicted follows the last one
    that was not, and may be earlier than this one."""
    silent: bool = False
    """Whether its estimate is not given out, because a predicted sample was at least as late."""

    @property
    def angles(self) -> Vector:
        """Of motors, then joints, shape (axes,)."""
        return np.concatenate([self.motor_angle, self.joint_angle])

    def known_since(self, before: Sample | None) -> Sample:
        """The sample with the angles of an earlier one where nothing is known of them now."""
        if before is None:
            return self
        return self._replace(
            motor_angle=np.where(np.isnan(self.motor_angle), before.motor_angle, self.motor_angle),
            joint_angle=np.where(np.isnan(self.joint_angle), before.joint_angle, self.joint_angle),
        )


@dataclass(frozen=True)
class Samples:
    """Encoder readings over time."""

    stamp_ns: NDArray[np.int64]
    """Increasing [ns], shape (n,)."""
    motor_angle: NDArray[np.float64]
    """[rad], shape (n, motors); NaN where nothing is known of it."""
    joint_angle: NDArray[np.float64]
    """[rad], shape (n, joints), likewise."""
    unseen: NDArray[np.float64] = field(default_factory=lambda: ALL_SEEN_OVER_TIME)
    """As ``Sample.unseen``, shape (n, 2, axes); (0, 0, 0) where all are zero."""
    doubtful: NDArray[np.bool_] = field(default_factory=lambda: NO_DOUBTS)
    """As ``Sample.doubtful``, shape (n, axes); of length 0 where all are false."""
    after_gap: NDArray[np.bool_] = field(default_factory=lambda: NO_DOUBTS)
    """As ``Sample.after_gap``, likewise."""
    offset_rows: NDArray[np.int64] = field(default_factory=lambda: NO_ROWS)
    """The samples at which the offsets' standard deviations change, increasing, shape (k,)."""
    offset: NDArray[np.float64] = field(default_factory=lambda: NO_OFFSETS)
    """As ``Sample.offset`` of these, shape (k, 2, axes)."""

    @property
    def unread(self) -> NDArray[np.bool_]:
        """Whether nothing is known of an angle, of motors, then joints, shape (n, axes)."""
        return np.isnan(np.hstack([self.motor_angle, self.joint_angle]))

    def whole(self) -> Samples:
        """The stamps and angles of those in which all angles are known; all of these if each is."""
        whole = ~self.unread.any(axis=1)
        if whole.all():
            return self
        return Samples(self.stamp_ns[whole], self.motor_angle[whole], self.joint_angle[whole])

    def filled(self, robot: Robot) -> Samples:
        """The samples with the last known angles where one is unknown, or else the references."""
        if not self.unread.any():
            return self
        angles = np.hstack([self.motor_angle, self.joint_angle])
        _fill(angles, self.unread, np.array([axis.reference_angle for axis in robot.as_read.axes]))
        motors = self.motor_angle.shape[1]
        return replace(self, motor_angle=angles[:, :motors], joint_angle=angles[:, motors:])

    def part(self, where: slice) -> Samples:
        """A slice of the samples, as views."""
        begin, end, _ = where.indices(self.stamp_ns.size)
        here = slice(self._holds_at(begin), int(np.searchsorted(self.offset_rows, end)))
        return Samples(
            self.stamp_ns[where],
            self.motor_angle[where],
            self.joint_angle[where],
            self.unseen[where],
            self.doubtful[where],
            self.after_gap[where],
            np.maximum(self.offset_rows[here] - begin, 0),
            self.offset[here],
        )

    def _holds_at(self, k: int) -> int:
        """Index of the offset that holds at a sample; 0 if none does yet."""
        return max(int(np.searchsorted(self.offset_rows, k, side="right")) - 1, 0)

    def at(self, k: int) -> Sample:
        """One sample, as views."""
        unseen = self.unseen[k] if len(self.unseen) else ALL_SEEN
        doubtful, after_gap = (
            every[k] if len(every) and every[k].any() else NO_DOUBTS
            for every in (self.doubtful, self.after_gap)
        )
        changed = self.offset[self.offset_rows == k]
        offset = changed[0] if len(changed) else NONE_CHANGED
        return Sample(
            int(self.stamp_ns[k]),
            self.motor_angle[k],
            self.joint_angle[k],
            unseen,
            offset,
            doubtful,
            after_gap,
        )

    def alone(self, k: int) -> Sample:
        """One sample for who does not take all before it: with the offset that holds there."""
        here = self._holds_at(k)
        known = here < len(self.offset) and self.offset_rows[here] <= k
        return self.at(k)._replace(offset=self.offset[here]) if known else self.at(k)


def on_axes(model: Model, axes: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The elements of cables whose paths lead over one of some axes, by ``Model.touched``.

    Args:
        model: the robot.
        axes: flags as of ``Sample.doubtful`` or ``Samples.doubtful``.

    Returns:
        Shape (elements,) or (n, elements); of length 0 where no axis is flagged.
    """
    if not axes.size or not axes.any():
        return NO_DOUBTS
    return axes @ model.touched[: axes.shape[-1]]  # those without encoder are not flagged


class LastKnown:
    """The last estimates of the cables of which nothing is known, to be shown as ``STALE``.

    So are the efforts of their axes.  What has never been known is ``INVALID``.
    """

    def __init__(self, model: Model) -> None:
        """Begin without an estimate."""
        layout, robot = model.layout, model.robot
        cables = np.arange(len(robot.cables))
        of_elements = robot.per_element(cables)
        of_pulleys = of_elements[layout.element_before]
        axes = len(cables) + np.arange(len(layout.motors) + len(layout.joints))
        owners = {
            **dict.fromkeys(("tension", "status"), of_elements),
            **dict.fromkeys(
                ("force_x", "force_y", "force_z", "magnitude", "friction", "slip_speed"), of_pulleys
            ),
            "motor_effort": axes[: len(layout.motors)],
            "joint_effort": axes[len(layout.motors) :],
            **dict.fromkeys(("iterations", "residual"), cables),
        }
        self._touched = model.touched[:, [part.start for part in robot.parts]].astype(np.uint8)
        self._status = layout.status
        self._owner = np.zeros(layout.size, dtype=np.int64)
        for part, own in owners.items():
            self._owner[getattr(layout, part)] = own
        self._stddev_owner = np.concatenate([owners[part] for part in layout.stddev])
        self._values = np.zeros(layout.size)
        self._values[layout.status] = INVALID
        self._stddev = np.zeros(self._stddev_owner.size)

    def keep(self, estimate: Estimate) -> None:
        """Take an estimate in which all is known."""
        self._values = estimate.values
        self._stddev = self._stddev if estimate.stddev is None else estimate.stddev

    def hold(
        self, unread: NDArray[np.bool_], values: Vector, stddev: Vector | None
    ) -> NDArray[np.bool_]:
        """Take further estimates, and put the last known ones where nothing is known of a cable.

        Args:
            unread: as ``Samples.unread``, shape (n, axes).
            values: estimates, shape (n, layout.size); changed.
            stddev: their standard deviations, shape (n, columns); changed; None: there are none.

        Returns:
            Whether nothing is known of every element, shape (n, elements).
        """
        unknown = np.zeros(values.shape, dtype=np.bool_)
        if unread.any():
            cables = unread @ self._touched
            gone = np.hstack([cables, unread | (cables @ self._touched.T)]) > 0
            unknown = gone[:, self._owner]
            _fill(values, unknown, self._values)
            flags = values[:, self._status].astype(np.uint8)
            known = unknown[:, self._status] & (flags & INVALID == 0)
            values[:, self._status] = flags | np.where(known, STALE, 0)
            if stddev is not None:
                _fill(stddev, gone[:, self._stddev_owner], self._stddev)
        self._values = values[-1]
        self._stddev = self._stddev if stddev is None else stddev[-1]
        return unknown[:, self._status]


def _fill(rows: Vector, unknown: NDArray[np.bool_], before: Vector) -> None:
    """Put the last known number of its column where one is unknown; that ``before`` is known."""
    count = np.arange(1, len(rows) + 1)[:, None]
    last = np.maximum.accumulate(np.where(unknown, 0, count), axis=0)
    rows[:] = np.take_along_axis(np.vstack([before, rows]), last, axis=0)


NEVER: Final = _core.NEVER
"""Stamp of a state before its first sample."""


State = _core.State
"""History-dependent state of the cables; opaque, never changed in place."""


class Angles(NamedTuple):
    """Estimated angles of the joints without encoder over time."""

    names: tuple[str, ...]
    value: NDArray[np.float64]
    """[rad], of prismatic joints [m], shape (n, joints without encoder); NaN where unknown."""
    stddev: NDArray[np.float64]
    """Their standard deviations."""


class Quantities:
    """What estimates hold, as arrays: of one time, or with a leading dimension over time."""

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def layout(self) -> Layout:
            """Names and columns of ``values``."""

        @property
        def values(self) -> Vector:
            """All quantities in the order of ``layout``, shape (..., layout.size)."""

        @property
        def stddev(self) -> Vector | None:
            """Standard deviations in the order of ``stddev_columns``; None without any."""

    @property
    def tension(self) -> Vector:
        """Tension of every element [N], shape (..., elements)."""
        return self.values[..., self.layout.tension]

    @property
    def status(self) -> Vector:
        """Status flags of every element, shape (..., elements)."""
        return self.values[..., self.layout.status]

    @property
    def force_x(self) -> Vector:
        """Force on every pulley [N], shape (..., pulleys)."""
        return self.values[..., self.layout.force_x]

    @property
    def force_y(self) -> Vector:
        """Force on every pulley [N], shape (..., pulleys)."""
        return self.values[..., self.layout.force_y]

    @property
    def force_z(self) -> Vector:
        """Force on every pulley [N], shape (..., pulleys); 0 for cables in a plane."""
        return self.values[..., self.layout.force_z]

    @property
    def nodal_force(self) -> Vector:
        """Magnitude of the force on every pulley [N], eq. (38), shape (..., pulleys)."""
        return self.values[..., self.layout.magnitude]

    @property
    def friction(self) -> Vector:
        """Tension after minus tension before every pulley [N], shape (..., pulleys)."""
        return self.values[..., self.layout.friction]

    @property
    def slip_speed(self) -> Vector:
        """Slip speed of the cable over every pulley [m/s], shape (..., pulleys)."""
        return self.values[..., self.layout.slip_speed]

    @property
    def motor_effort(self) -> Vector:
        """Torque of the cables on every motor by ``effort_sign`` [N m], shape (..., motors)."""
        return self.values[..., self.layout.motor_effort]

    @property
    def joint_effort(self) -> Vector:
        """Torque of the cables on every joint [N m], shape (..., joints)."""
        return self.values[..., self.layout.joint_effort]

    @property
    def tension_stddev(self) -> Vector | None:
        """Standard deviations of ``tension`` [N]; None if none are estimated."""
        return None if self.stddev is None else self.stddev[..., self.layout.stddev["tension"]]


@dataclass(slots=True)
class Estimate(Quantities):
    """All estimated quantities at one time, as views of one vector."""

    stamp_ns: Final[int]
    values: Final[Vector]
    """All quantities in the order of ``layout``, shape (layout.size,)."""
    layout: Final[Layout]
    solved: Final[bool]
    """False where some element is ``INVALID``, or ``STALE`` because an axis is not read."""
    stddev: Vector | None = None
    """Standard deviations in the order of ``stddev_columns``; None if none are estimated."""
    angles: Angles | None = None
    """Of the joints without encoder, one row; None where all have one or there is no effort."""

    @property
    def tensions(self) -> dict[str, float]:
        """Tension of every element [N], by ``cable/element``."""
        return _named(self.layout.elements, self.tension)

    @property
    def tension_stddevs(self) -> dict[str, float]:
        """Standard deviation of every tension [N], by ``cable/element``; empty without any."""
        return {} if (known := self.tension_stddev) is None else _named(self.layout.elements, known)

    @property
    def statuses(self) -> dict[str, int]:
        """Status flags of every element, by ``cable/element``; 0: nothing to report."""
        return {name: int(one) for name, one in _named(self.layout.elements, self.status).items()}

    @property
    def nodal_forces(self) -> dict[str, float]:
        """Magnitude of the force on every pulley [N], by ``cable/node``."""
        return _named(self.layout.pulleys, self.nodal_force)

    @property
    def joint_angles(self) -> dict[str, float]:
        """Estimated angles of the joints without encoder [rad], [m] of prismatic ones; or empty."""
        return {} if self.angles is None else _named(self.angles.names, self.angles.value[-1])

    @property
    def efforts(self) -> dict[str, float]:
        """Torque of the cables on every motor and joint [N m], of prismatic joints [N]."""
        layout = self.layout
        named = _named(layout.motors, self.motor_effort)
        return named | _named(layout.joints, self.joint_effort)


def _named(names: tuple[str, ...], values: Vector) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


@dataclass(frozen=True)
class Estimates(Quantities):
    """All estimated quantities over time."""

    stamp_ns: NDArray[np.int64]
    """[ns], shape (n,)."""
    values: NDArray[np.float64]
    """Shape (n, layout.size)."""
    layout: Layout
    stddev: NDArray[np.float64] | None = None
    """Standard deviations of tensions, magnitudes of nodal forces, efforts of motors and of joints,
    shape (n, elements + pulleys + motors + joints); see ``cdrj_ros.estimation.ensemble``."""
    angles: Angles | None = None
    """Of the joints without encoder; None where every joint has one."""
    refused: Mapping[str, int] = field(default_factory=dict)
    """Number of refused readings by cause, where it is known."""

    def columns(self) -> dict[str, NDArray[Any]]:
        """All estimates by name, each of shape (n,); ``pandas.DataFrame`` makes a table of them.

        Returns:
            ``stamp_ns`` [ns], ``tension/upper/8`` [N], ``nodal_force/upper/3`` [N] and
            ``effort/winch`` [N m]; ``stddev/...`` of all these, if any; and ``status/upper/8``.
        """
        at, places = channel_columns(self.layout), stddev_places(self.layout)
        named: dict[str, NDArray[Any]] = {"stamp_ns": self.stamp_ns}
        named |= {name: self.values[:, column] for name, column in at.items()}
        if self.stddev is not None:
            named |= {f"stddev/{name}": self.stddev[:, k] for name, k in places.items()}
        flags = self.status.astype(np.uint8).T
        elements = self.layout.elements
        return named | {f"status/{name}": one for name, one in zip(elements, flags, strict=True)}

    def plot(self, elements: Iterable[str] | None = None) -> Any:
        """Draw tensions over time with bands of two standard deviations.

        Args:
            elements: those to draw, such as ``["upper/8"]``; None: the last one of every cable.

        Returns:
            The ``matplotlib`` figure, for ``savefig``.  Where a status flag is set, the line is
            dotted.

        Raises:
            UsageError: an element that the robot does not have.
        """
        from matplotlib.figure import Figure

        names = self.layout.elements
        chosen = list({name.rpartition("/")[0]: name for name in names}.values())
        if elements is not None:
            chosen = list(elements)
        if unknown := [name for name in chosen if name not in names]:
            raise UsageError(f"there is no element {', '.join(unknown)}, only {', '.join(names)}")
        time_s = (self.stamp_ns - self.stamp_ns[:1]) * 1e-9
        figure = Figure(figsize=(9.0, 1.2 + 1.9 * len(chosen)), layout="constrained")
        rows = figure.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(rows, chosen, strict=True):
            k = names.index(name)
            tension, flagged = self.tension[:, k], self.status[:, k] != 0
            margin = 0.0
            if self.tension_stddev is not None:
                band = 2.0 * self.tension_stddev[:, k]
                margin = 1.1 * float(band[~flagged].max(initial=0.0))
                axes.fill_between(time_s, tension - band, tension + band, alpha=0.25, label="± 2σ")
            (line,) = axes.plot(
                time_s, np.where(flagged, np.nan, tension), label="estimate, status 0"
            )
            if flagged.any():
                axes.plot(
                    time_s, np.where(flagged, tension, np.nan), ":", color=line.get_color(),
                    label="estimate, with a status flag",
                )  # fmt: skip
            # bands of an unknown friction history would hide the tensions
            known = tension[np.isfinite(tension)]
            if known.size:
                least = 0.2 * float(np.ptp(known)) + 0.05 * float(np.abs(known).max())
                margin = max(margin, least)
                axes.set_ylim(float(known.min()) - margin, float(known.max()) + margin)
            axes.set_ylabel(f"{name} [N]")
        labelled = rows[0].get_legend_handles_labels()
        figure.legend(*labelled, loc="outside upper center", ncols=3, frameon=False)
        rows[-1].set_xlabel("time [s]")
        return figure


def initial_state(model: Model) -> State:
    """The state before any sample; the first sample initialises it without friction."""
    return State(NEVER, np.zeros(model.state_size))


def step(model: Model, state: State, sample: Sample) -> tuple[State, Estimate]:
    """Process one sample.

    Args:
        model: the prepared robot.
        state: from ``initial_state`` or the previous step.
        sample: later than the state; finite (see docs/estimation.md).

    Returns:
        The new state and the estimate at the sample's stamp.

    Raises:
        ValueError: the angles are not those of this robot.
    """
    after, values, solved = model.core.step(
        state, sample.stamp_ns, sample.motor_angle, sample.joint_angle
    )
    return after, Estimate(sample.stamp_ns, values, model.layout, solved)


def run(
    model: Model,
    state: State,
    samples: Samples,
    into: NDArray[np.float64] | None = None,
    *,
    slipping: NDArray[np.bool_] | None = None,
    chosen: NDArray[np.bool_] | None = None,
) -> tuple[State, Estimates]:
    """Apply ``step`` to many samples in one call; the results are bit-identical.

    Args:
        model: the prepared robot.
        state: as for ``step``.
        samples: n samples.
        into: output array for the estimates, shape (n, layout.size); None: a new array.
        slipping: which cables slip on their drums, so that the drums do not keep the strain at
            which cable went on, shape (cables,); None: none.
        chosen: which cables are computed, shape (cables,), the tensions of the others and their
            shares of efforts are 0; None: all.
    """
    stamps = samples.stamp_ns
    estimates = np.empty((stamps.size, model.layout.size)) if into is None else into
    after = model.core.run(
        state, stamps, samples.motor_angle, samples.joint_angle, estimates, slipping, chosen
    )
    return after, Estimates(stamps, estimates, model.layout)
