"""Random faults, one of each kind or several together, and the motions in which they happen."""

import numpy as np

from cdrj_ros.simulation import motion
from support.campaign import (
    CELL,
    EFFORT,
    FASTEST,
    MS,
    SECOND,
    Faults,
    Lie,
    course_of,
    sine,
)

SECONDS = 16.0
"""Duration of a run [s]."""
COURSES = 20
"""Number of different courses."""
SEEN = {"winch": 20 * MS, "elbow": 20 * MS}
"""Longest periods of axes whose encoder slips [ns]."""


def course(model, index):
    """One of ``COURSES`` courses: sinusoids of 0.05 to 3 Hz, mixtures, ramps and dwells."""
    generator = np.random.default_rng([index, 5])
    hertz = 0.05 * 60.0 ** ((index % 10) / 9.0)
    amplitude = float(min(0.6, FASTEST / (2.0 * np.pi * hertz)))
    moves = {
        0: sine(hertz),
        1: motion.ramps(float(min(0.6, 0.2 / hertz)), hertz),
        2: motion.dwell(float(min(0.6, 0.15 / hertz)), hertz),
        3: motion.random(amplitude, hertz, index),
    }[int(generator.integers(0, 4)) if index >= 10 else 0]
    load = 0.3 if index % 3 == 2 and hertz < 0.4 else 0.0
    return course_of(model, SECONDS, moves, load=load, seed=index)


def _time(generator):
    """Random time between 35 % and 80 % of the run [ns]."""
    return int(generator.uniform(0.35, 0.8) * SECONDS * SECOND)


def _size(generator, least, most):
    """A size of either sign, as often in every decade."""
    size = np.exp(generator.uniform(np.log(least), np.log(most)))
    return float(generator.choice((-1.0, 1.0)) * size)


def _axes(generator):
    both = (("winch",), ("elbow",), ("winch", "elbow"))
    return both[generator.integers(0, 3)]


def _gap(faults, generator):
    for _ in range(int(generator.integers(1, 4))):
        begin = _time(generator)
        end = begin + int(10.0 ** generator.uniform(-1.5, 0.3) * SECOND)
        faults.gaps += [(axis, begin, end) for axis in _axes(generator)]


def _slow(faults, generator):
    period = int(SECOND / 10.0 ** generator.uniform(-0.3, 2.3))
    for axis in _axes(generator):
        faults.period_ns[axis] = period
    faults.phase_ns = int(generator.uniform(0.0, 1.0) * period)


def _lost(faults, generator):
    for axis in _axes(generator):
        faults.lost[axis] = float(generator.uniform(0.5, 0.9))


def _late(faults, generator):
    axis = ("winch", "elbow")[generator.integers(0, 2)]
    faults.late_ns[axis] = int(10.0 ** generator.uniform(-3.0, 0.5) * SECOND)


def _predict(draw):
    def drawn(faults, generator):
        draw(faults, generator)
        faults.mode = "predict"

    return drawn


def _a_little_late(faults, generator):
    faults.late_ns["elbow"] = int(generator.uniform(2.0, 25.0) * MS)


def _slip(axis):
    half_a_count = {"winch": 3.8e-5, "elbow": 1.9e-4}[axis]

    def drawn(faults, generator):
        most = 2.0 * np.pi if axis == "winch" else 0.5
        faults.slips.append((axis, _time(generator), _size(generator, half_a_count, most)))

    return drawn


def _slip_in_a_restart(axis):
    def drawn(faults, generator):
        _restart(faults, generator)
        at = faults.restart_ns + faults.stop_ns // 2
        faults.slips.append((axis, at, _size(generator, 1e-3, 1.0 if axis == "winch" else 0.3)))

    return drawn


def _wrong(faults, generator):
    axis = ("winch", "elbow")[generator.integers(0, 2)]
    faults.wrong[axis] = float(generator.uniform(1e-3, 1e-2)), _size(generator, 1e-3, 0.3)


def _second(faults, generator):
    axis = ("winch", "elbow")[generator.integers(0, 2)]
    faults.second[axis] = _size(generator, 1e-3, 0.3)


def _clock_offset(faults, generator):
    faults.clocks["elbow"] = int(_size(generator, 1.0, 20.0) * MS), 0.0


def _clock_creep(faults, generator):
    faults.clocks["elbow"] = 0, _size(generator, 3e-5, 1e-3)


def _wrap(faults, _generator):
    faults.wrap = True


def _tare(faults, generator):
    faults.tare_ns = _time(generator)


def _restart(faults, generator):
    faults.restart_ns = _time(generator)
    faults.stop_ns = int(10.0 ** generator.uniform(-2.0, 0.5) * SECOND)


def _clock(faults, generator):
    by = int(generator.choice((-3600, -5, 5, 3600))) * SECOND
    faults.clock_ns = _time(generator), by


def _sensors(*names):
    def drawn(faults, _generator):
        faults.sensors = (*faults.sensors, *(n for n in names if n not in faults.sensors))

    return drawn


def _lie(name, how, least=1.0, most=1.0):
    """A sensor that lies from the start or later, half of them beside another one that is right.

    The sizes are for a load cell; an effort has a hundredth of them, but for scales.
    """

    def drawn(faults, generator):
        since = int(generator.choice((0.0, generator.uniform(0.3, 0.8))) * SECONDS * SECOND)
        size = _size(generator, least, most)
        faults.lies[name] = Lie(
            how, since, 0.01 * size if name == EFFORT and how != "scales" else size
        )
        _sensors(*(name,) if generator.random() < 0.5 else (CELL, EFFORT))(faults, generator)

    return drawn


def _nothing(_faults, _generator):
    pass


SINGLE = {
    "none": _nothing,
    "none, load cell": _sensors(CELL),
    "none, effort": _sensors(EFFORT),
    "none, load cell and effort": _sensors(CELL, EFFORT),
    "gaps of 0.03 to 2 s": _gap,
    "topics of 0.5 to 200 Hz": _slow,
    "50 to 90 % of readings lost": _lost,
    "topic late by 1 ms to 3 s": _late,
    "`predict`, 50 to 90 % lost": _predict(_lost),
    "`predict`, joint late by 2 to 25 ms": _predict(_a_little_late),
    "`predict`, topics of 0.5 to 200 Hz": _predict(_slow),
    "joint slips by half a count to 0.5 rad": _slip("elbow"),
    "motor slips by half a count to a turn": _slip("winch"),
    "joint slips while the estimator restarts": _slip_in_a_restart("elbow"),
    "motor slips while the estimator restarts": _slip_in_a_restart("winch"),
    "0.1 to 1 % of readings wrong": _wrong,
    "two publishers, 1 to 300 mrad apart": _second,
    "clocks differ by 1 to 20 ms": _clock_offset,
    "clocks creep by 30 to 1000 ppm": _clock_creep,
    "no `period` in the file": _wrap,
    "tare": _tare,
    "restart": _restart,
    "clock set by 5 s or an hour": _clock,
    "cell freezes": _lie(CELL, "freezes"),
    "cell stuck at 1 to 60 N": _lie(CELL, "is stuck", 1.0, 60.0),
    "cell off by 0.5 to 12 N": _lie(CELL, "is off", 0.5, 12.0),
    "cell wild by 10 to 50 N": _lie(CELL, "is wild", 10.0, 50.0),
    "cell drifts by 0.1 to 3 N/s": _lie(CELL, "drifts", 0.1, 3.0),
    "cell scaled by 2 to 50 %": _lie(CELL, "scales", 0.02, 0.5),
    "effort freezes": _lie(EFFORT, "freezes"),
    "effort stuck at 1 to 200 mN m": _lie(EFFORT, "is stuck", 0.1, 20.0),
    "effort off by 5 to 120 mN m": _lie(EFFORT, "is off", 0.5, 12.0),
    "effort drifts by 1 to 30 mN m/s": _lie(EFFORT, "drifts", 0.1, 3.0),
    "effort scaled by 2 to 50 %": _lie(EFFORT, "scales", 0.02, 0.5),
}  # fmt: skip
"""Every kind of fault, by the name of its row."""


def single(kind, seed):
    """One fault of a kind."""
    faults = Faults()
    SINGLE[kind](faults, np.random.default_rng([seed, list(SINGLE).index(kind)]))
    return _seen(faults)


def mixed(seed):
    """One to three faults of different kinds, and their names."""
    generator = np.random.default_rng([seed, 99])
    count = int(generator.integers(1, 4))
    kinds = tuple(list(SINGLE)[k] for k in generator.choice(len(SINGLE), count, replace=False))
    faults = Faults()
    for kind in kinds:
        SINGLE[kind](faults, generator)
    if generator.random() < 0.2:
        faults.mode = "predict"
    return kinds, _seen(faults)


def _seen(faults):
    """Read an encoder while it slips or wraps: nothing in readings far apart tells a slip.

    That is a limit of the estimator (docs/reliability.md), not a fault that it could find.  A slip
    within a restart is one that it finds by the pose.
    """
    axes = [axis for axis, at, _ in faults.slips if not _stopped(faults, at)]
    for axis in axes:
        faults.period_ns[axis] = min(faults.period_ns[axis], SEEN["winch"])
        faults.gaps = [gap for gap in faults.gaps if gap[0] != axis]
    if axes:
        faults.restart_ns = None
    if faults.wrap:
        faults.period_ns["winch"] = min(faults.period_ns["winch"], SECOND // 20)
    return faults


def _stopped(faults, at):
    begin = faults.restart_ns
    return begin is not None and begin <= at <= begin + faults.stop_ns
