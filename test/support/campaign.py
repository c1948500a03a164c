"""Random combinations of input faults, compared with an undisturbed run of the same motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation import estimator
from cdrj_ros.estimation.session import LiveEstimator, Options, Output
from cdrj_ros.estimation.state_file import read_state, write_state
from cdrj_ros.estimation.whole_recording import condition
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.series import Series
from cdrj_ros.model.prepared import Model, shape_at

Kind = Literal[
    "gap", "slow", "late", "slip", "cell", "effort", "tare", "restart", "clock", "wrap", "liar"
]
KINDS: tuple[Kind, ...] = get_args(Kind)
Lie = Literal["freezes", "says zero", "doubles", "is off", "is wild", "drifts"]
LIES: tuple[Lie, ...] = get_args(Lie)
Axis = Literal["winch", "elbow"]
Mode = Literal["wait", "predict"]
Stamps = NDArray[np.int64]
Vector = NDArray[np.float64]

START = 1_700_000_000 * 10**9
MS = 1_000_000
SECOND = 1_000_000_000
SLOWEST_NS = 100 * MS
"""Readings further apart cannot tell a slip from a motion [ns]."""
CELL = 7
"""Index of ``upper/8`` in the prototype."""
SMALLEST = 1e-3
"""Lower bound of standard deviations; smaller ones are rounding errors [N]."""


@dataclass(frozen=True)
class Course:
    """True angles at 1 kHz and the undisturbed estimates for them."""

    winch: Vector
    elbow: Vector
    tension: Vector
    """Undisturbed estimate of the tension [N], shape (n, elements)."""
    effort: Vector
    """Undisturbed estimate of the motor's effort [N m], shape (n,)."""

    @property
    def duration_ns(self) -> int:
        return self.winch.size * MS

    def angle(self, name: str, stamps: Stamps) -> Vector:
        """Angle of an axis [rad] at stamps since the start [ns]."""
        return np.interp(stamps, MS * np.arange(self.winch.size), getattr(self, name))


@dataclass
class Faults:
    """Faults of the inputs of one run; none by default."""

    period_ns: dict[str, int] = field(default_factory=lambda: {"winch": MS, "elbow": MS})
    phase: float = 0.0
    """First reading of axes slower than ``SLOWEST_NS``, as a share of their period."""
    gaps: list[tuple[str, int, int]] = field(default_factory=list)
    """Axis, begin and end [ns]."""
    late_ns: dict[str, int] = field(default_factory=dict)
    """Delay of the messages by axis [ns]."""
    slip: tuple[int, float] | None = None
    """Time [ns] and size [rad] of a slip of the winch's encoder."""
    wrap: bool = False
    """Whether the winch's encoder wraps after a turn although the robot file gives no wrapping."""
    restart_ns: int | None = None
    """Time at which the estimator stops, to be restarted from its state file [ns]."""
    stop_ns: int = 0
    """Duration of that stop [ns]."""
    clock_ns: tuple[int, int] | None = None
    """Time and size of a jump of the inputs' clock [ns]."""
    cell: float | None = None
    """Constant reading of a stuck load cell at ``upper/8`` [N]."""
    cell_ns: int = 10 * MS
    """Interval of the readings of the load cell [ns]."""
    effort: float | None = None
    """Constant effort that the motor's driver reports [N m]."""
    noise: float = 0.0
    """Noise of these constant readings [N] or [N m]."""
    good_effort: bool = False
    """Whether the preloads are tracked by an effort that is right, beside a liar."""
    liar: tuple[Lie, int] | None = None
    """How, and since when [ns], a load cell at ``upper/8`` lies that was good until then."""
    off: float = 5.0
    """How much a liar that "is off" reads too high, and one that "drifts" after 5 s [N]."""
    tare_ns: int | None = None
    """Time of a call of tare [ns]."""
    mode: Mode = "wait"

    def words(self) -> str:
        """Description of the faults for the message of a failed test."""
        return ", ".join(f"{k}={v}" for k, v in vars(self).items() if v != getattr(Faults(), k))


def quarter_rate() -> dict[str, int]:
    """Periods of readings at 250 Hz [ns], for laws that hold at any rate, in less time."""
    return {"winch": 4 * MS, "elbow": 4 * MS}


def courses(model: Model, seconds: float, kinds: Sequence[int]) -> list[Course]:
    """Smooth motions of the robot with their undisturbed estimates."""
    return [_course(model, seconds, kind) for kind in kinds]


def _course(model: Model, seconds: float, kind: int) -> Course:
    time = 0.001 * np.arange(round(1000 * seconds))
    hertz, amplitude = ((0.1, 0.6), (0.3, 0.45), (0.2, 0.6))[kind]
    elbow = amplitude * np.sin(2.0 * np.pi * hertz * time)
    if kind == 2:  # two frequencies
        elbow = 0.75 * elbow + 0.05 * np.sin(2.0 * np.pi * 0.7 * time)
    winch = follow(model, elbow)
    stamps = START + MS * np.arange(winch.size)
    axes = {"winch": Series(stamps, stamps, winch)}, {"elbow": Series(stamps, stamps, elbow)}
    (samples,) = condition(model.robot, *axes).segments
    assert np.array_equal(samples.stamp_ns, stamps)
    values = estimator.run(model, estimator.initial_state(model), samples)[1].values
    effort = values[:, model.layout.motor_effort][:, 0]
    return Course(winch, elbow, values[:, model.layout.tension], effort)


def follow(model: Model, elbow: Vector) -> Vector:
    """Winch angles that approximately follow the cable lengths required by the joint angles."""
    grid = np.linspace(elbow.min(), elbow.max(), 41)
    cable = model.robot.cables[0]
    count = len(cable.element_names)
    lengths = np.array([shape_at(model, np.array([angle])).length[:count].sum() for angle in grid])
    node = cable.nodes[0]
    reference = shape_at(model, np.zeros(1)).length[:count].sum()
    turned = -node.winding * (lengths - reference) / node.radius  # type: ignore[union-attr]
    return np.interp(elbow, grid, turned)


def stamps_of(course: Course, faults: Faults, name: str) -> Stamps:
    """Stamps of the readings of an axis since the start [ns]."""
    period = faults.period_ns[name]
    first = int(faults.phase * period) if period > SLOWEST_NS else 0
    stamps = np.arange(first, course.duration_ns, period, dtype=np.int64)
    for axis, begin, end in faults.gaps:
        if axis == name:
            stamps = stamps[(stamps < begin) | (stamps > end)]
    if faults.restart_ns is not None:
        begin, end = faults.restart_ns, faults.restart_ns + faults.stop_ns
        stamps = stamps[(stamps < begin) | (stamps > end)]
    return stamps


def readings_of(course: Course, faults: Faults, name: str) -> tuple[Stamps, Vector]:
    """Stamps since the start [ns] and readings [rad] of an axis."""
    stamps = stamps_of(course, faults, name)
    values = course.angle(name, stamps)
    if name == "winch":
        if faults.slip is not None:
            values = values + faults.slip[1] * (stamps >= faults.slip[0])
        if faults.wrap:
            values = np.mod(values + np.pi, 2.0 * np.pi) - np.pi
    return stamps, values


def run(
    model: Model,
    course: Course,
    faults: Faults,
    options: Options | None = None,
    scratch: Path | None = None,
    watch: Callable[[LiveEstimator], object] | None = None,
) -> list[Output]:
    """Feed the course with its faults; the stamps of the outputs refer to the course's clock.

    Args:
        model: the robot.
        course: the motion.
        faults: the faults of the inputs.
        options: options of the estimator.
        scratch: a folder for the state file of a restart.
        watch: called with the estimator at the end.
    """
    options = options or Options(
        conditioning=faults.mode,
        tension_sensors=faults.cell is not None or faults.liar is not None,
        track_preload=faults.effort is not None or faults.good_effort,
    )
    live = LiveEstimator(model, options)
    outputs: list[Output] = []
    for arrival, kind, name, stamp, value in _messages(course, faults):
        if faults.restart_ns is not None and arrival > faults.restart_ns and scratch is not None:
            write_state(live, scratch / "state")
            live, faults = LiveEstimator(model, options), _once(faults, "restart_ns")
            read_state(live, scratch / "state")
        if faults.tare_ns is not None and arrival > faults.tare_ns:
            faults = _once(faults, "tare_ns")
            _try_tare(live)
        set_by = 0
        if faults.clock_ns is not None and stamp >= faults.clock_ns[0]:
            set_by = faults.clock_ns[1]
        if name == "winch":
            _feed_sensors(live, course, faults, stamp, set_by)
        made = live.feed(kind, START + stamp + set_by, (name,), (value,))[1]
        outputs += [_moved(output, set_by) for output in made] if set_by else made
    if watch is not None:
        watch(live)
    return outputs


def _messages(course: Course, faults: Faults) -> list[tuple[int, str, str, int, float]]:
    """Arrival [ns], kind, axis, stamp [ns] and reading [rad] of all messages, in order."""
    messages = []
    for name, kind in (("winch", "motors"), ("elbow", "joints")):
        stamps, values = readings_of(course, faults, name)
        late = faults.late_ns.get(name, 0)
        messages += [
            (stamp + late, kind, name, stamp, value)
            for stamp, value in zip(stamps.tolist(), values.tolist(), strict=True)
        ]
    return sorted(messages)


def _feed_sensors(
    live: LiveEstimator, course: Course, faults: Faults, stamp: int, set_by: int
) -> None:
    """Feed the stuck sensors' readings at a stamp [ns]; ``set_by`` is the clock's offset [ns]."""
    k = stamp // MS
    noise = faults.noise * np.sin(1e3 * k)  # as good as random
    if faults.effort is not None:
        live.feed_efforts(START + stamp + set_by, ("winch",), (faults.effort + noise,))
    elif faults.good_effort and course.effort.size:
        effort = float(course.effort[k]) + 0.005 * np.sin(1e3 * k)
        live.feed_efforts(START + stamp + set_by, ("winch",), (effort,))
    period = faults.period_ns["winch"]
    cell_reads = stamp % faults.cell_ns < (period if period < faults.cell_ns else 1)
    if faults.cell is not None and cell_reads:
        live.feed_tensions(START + stamp + set_by, ("upper/8",), (faults.cell + noise,), (0.05,))

    if faults.liar is not None and course.tension.size and cell_reads:
        value = _lie(course, faults.liar, k, faults.off)
        live.feed_tensions(START + stamp + set_by, ("upper/8",), (value,), (0.05,))


def _lie(course: Course, liar: tuple[Lie, int], k: int, off: float) -> float:
    """Reading of the liar at the k-th millisecond [N]."""
    how, since = liar[0], liar[1] // MS
    true = float(course.tension[k, CELL]) + 0.05 * np.sin(1e3 * k)  # as good as random
    if k < since:
        return true
    return {
        "freezes": float(course.tension[since, CELL]), "says zero": 0.0, "doubles": 2.0 * true,
        "is off": true + off, "is wild": true + (40.0 if k % 30 == 0 else 0.0),
        "drifts": true + off * (k - since) / 5000.0,
    }[how]  # fmt: skip


def _once(faults: Faults, name: str) -> Faults:
    return Faults(**{**vars(faults), name: None})


def _try_tare(live: LiveEstimator) -> None:
    with suppress(UsageError):
        live.tare()


def _moved(output: Output, by: int) -> Output:
    """The output with its stamp converted back to the course's clock."""
    estimate = output.estimate
    return output._replace(estimate=replace(estimate, stamp_ns=estimate.stamp_ns - by))


@dataclass(frozen=True)
class Verdict:
    """Errors of the estimates with status 0, over all elements and samples."""

    ratio: Vector
    """|error| / standard deviation of all estimates with status 0 [-]."""
    worst: float
    """Largest of these errors [N]."""
    judged: int
    """Number of elements times samples of any status."""

    def beyond(self, sigmas: float) -> float:
        """Share of the estimates with status 0 whose error exceeds ``sigmas`` deviations [-]."""
        return float(np.mean(self.ratio > sigmas)) if self.ratio.size else 0.0


def judge(course: Course, outputs: Sequence[Output], begin_ns: int, end_ns: int) -> Verdict:
    """Judge the estimates whose stamps lie between two times since the start [ns]."""
    inside = [o for o in outputs if begin_ns <= o.estimate.stamp_ns - START < end_ns]
    if not inside:
        return Verdict(np.empty(0), 0.0, 0)
    elements = course.tension.shape[1]
    since = np.array([o.estimate.stamp_ns - START for o in inside])
    low = np.minimum(since // MS, course.winch.size - 1)
    high = np.minimum(low + 1, course.winch.size - 1)
    share = ((since - low * MS) / MS)[:, None]
    truth = course.tension[low] + share * (course.tension[high] - course.tension[low])
    error = np.abs(np.array([o.estimate.tension for o in inside]) - truth)
    stddev = np.array([o.stddev[:elements] for o in inside if o.stddev is not None])
    good = np.array([o.estimate.status for o in inside]) == 0
    ratio = error / np.maximum(stddev, SMALLEST)
    worst = float(error[good].max()) if good.any() else 0.0
    return Verdict(ratio[good], worst, error.size)


def draw_kinds(generator: np.random.Generator) -> tuple[Kind, ...]:
    """One to three kinds of faults for one run."""
    count = int(generator.integers(1, 4))
    return tuple(KINDS[k] for k in generator.choice(len(KINDS), size=count, replace=False))


def draw_faults(generator: np.random.Generator, duration_ns: int) -> Faults:
    """One to three faults of random kinds for one run, each at a random time and of random size."""
    faults = Faults()
    for kind in draw_kinds(generator):
        _FAULTS[kind](faults, generator, duration_ns)
    if generator.random() < 0.2:
        faults.mode = "predict"
    _let_slips_be_seen(faults)
    faults.phase = float(generator.random())
    return faults


def _let_slips_be_seen(faults: Faults) -> None:
    """Read the winch while its encoder slips or wraps: readings far apart cannot tell it.

    That is a limit of the estimator (docs/reliability.md), not a fault that it could find.
    """
    if faults.slip is not None:
        faults.period_ns["winch"] = min(faults.period_ns["winch"], SECOND // 50)
        at = faults.slip[0]
        faults.gaps = [
            (axis, begin, end)
            for axis, begin, end in faults.gaps
            if axis != "winch" or not begin - SLOWEST_NS < at < end + SLOWEST_NS
        ]
        stopped = faults.restart_ns
        if (
            stopped is not None
            and stopped - SLOWEST_NS < at < stopped + faults.stop_ns + SLOWEST_NS
        ):
            faults.restart_ns = None
    if faults.wrap:
        faults.period_ns["winch"] = min(faults.period_ns["winch"], SECOND // 20)


def _time(generator: np.random.Generator, duration_ns: int) -> int:
    """Random time between 35 % and 80 % of the run [ns]."""
    return int(generator.uniform(0.35, 0.8) * duration_ns)


def _gap(faults: Faults, generator: np.random.Generator, duration_ns: int) -> None:
    for _ in range(int(generator.integers(1, 4))):
        begin = _time(generator, duration_ns)
        end = begin + int(10.0 ** generator.uniform(-1.5, 0.3) * SECOND)
        for axis in (("winch",), ("elbow",), ("winch", "elbow"))[generator.integers(0, 3)]:
            faults.gaps.append((axis, begin, end))


def _slow(faults: Faults, generator: np.random.Generator, _duration_ns: int) -> None:
    period = int(SECOND / 10.0 ** generator.uniform(-0.3, 2.3))
    for axis in (("winch",), ("elbow",), ("winch", "elbow"))[generator.integers(0, 3)]:
        faults.period_ns[axis] = period


def _late(faults: Faults, generator: np.random.Generator, _duration_ns: int) -> None:
    axis = ("winch", "elbow")[generator.integers(0, 2)]
    faults.late_ns[axis] = int(10.0 ** generator.uniform(-3.0, 0.5) * SECOND)


def _slip(faults: Faults, generator: np.random.Generator, duration_ns: int) -> None:
    sign = generator.choice((-1.0, 1.0))
    faults.slip = _time(generator, duration_ns), float(sign * generator.uniform(0.4, 3.0))


def _wrap(faults: Faults, _generator: np.random.Generator, _duration_ns: int) -> None:
    faults.wrap = True


def _cell(faults: Faults, generator: np.random.Generator, _duration_ns: int) -> None:
    faults.cell = float(generator.choice((0.0, 15.0, 30.0, 60.0)))


def _liar(faults: Faults, generator: np.random.Generator, duration_ns: int) -> None:
    how = LIES[int(generator.integers(0, len(LIES)))]
    faults.liar = how, int(generator.uniform(0.5, 0.9) * duration_ns)
    faults.off = float(generator.choice((-1.0, 1.0)) * 10.0 ** generator.uniform(0.0, 1.1))
    faults.good_effort = bool(generator.random() < 0.5)


def _effort(faults: Faults, generator: np.random.Generator, _duration_ns: int) -> None:
    faults.effort = float(generator.choice((0.0, 0.05, -0.1)))


def _tare(faults: Faults, generator: np.random.Generator, duration_ns: int) -> None:
    faults.tare_ns = _time(generator, duration_ns)


def _restart(faults: Faults, generator: np.random.Generator, duration_ns: int) -> None:
    faults.restart_ns = _time(generator, duration_ns)
    faults.stop_ns = int(10.0 ** generator.uniform(-2.0, 0.5) * SECOND)


def _clock(faults: Faults, generator: np.random.Generator, duration_ns: int) -> None:
    by = int(generator.choice((-3600, -5, 5, 3600))) * SECOND
    faults.clock_ns = _time(generator, duration_ns), by


_FAULTS: Mapping[Kind, Callable[[Faults, np.random.Generator, int], None]] = {
    "gap": _gap, "slow": _slow, "late": _late, "slip": _slip, "cell": _cell, "effort": _effort,
    "tare": _tare, "restart": _restart, "clock": _clock, "wrap": _wrap, "liar": _liar,
}  # fmt: skip
