"""Estimation over a conditioned recording in pieces, and a bag that holds the estimates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import mark_unsure
from cdrj_ros.estimation.breaks import Unseen
from cdrj_ros.estimation.conditioner import Conditioned
from cdrj_ros.estimation.encoderless import EncoderlessEstimator, efforts_at
from cdrj_ros.estimation.ensemble import NO_STDDEVS, UNSURE_SHARE, Ensemble, stddev_columns
from cdrj_ros.estimation.estimator import (
    Angles,
    Estimates,
    LastKnown,
    Samples,
    initial_state,
    on_axes,
    run,
)
from cdrj_ros.evaluation.inputs import in_order
from cdrj_ros.foundation.arrays import Series, Table
from cdrj_ros.foundation.interruption import thread_pool
from cdrj_ros.messages.templates import ESTIMATE_MESSAGES
from cdrj_ros.messages.topics import in_namespace
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.recording import Recording
from cdrj_ros.recordings.source import open_source
from cdrj_ros.recordings.writer import BagWriter

T = TypeVar("T")

AT_ONCE: Final = 8192
"""Number of samples in a piece, which fit into the processor's cache; no estimate depends on it."""


def pieces_of(
    model: Model,
    samples: Samples,
    efforts: Mapping[str, Series] | None = None,
    *,
    uncertainty: bool = False,
) -> Iterator[Estimates]:
    """Estimate a pass from the initial state; yields the estimates of AT_ONCE samples at a time.

    The status is what a node with default parameters publishes for the same readings.

    Args:
        model: the prepared robot.
        samples: of one pass, with the joints that have encoders.
        efforts: of the motors by name [N m], from which joints without encoder are estimated.
        uncertainty: whether to estimate standard deviations, which about doubles the time; those
            of a robot with joints without encoder are estimated in any case.
    """
    if model.robot.unmeasured:
        at = efforts_at(samples.stamp_ns, model.layout.motors, efforts or {})
        return _pieces_encoderless(model, samples, at)
    return _pieces(model, samples, uncertainty)


def _pieces(model: Model, samples: Samples, uncertainty: bool) -> Iterator[Estimates]:
    """``pieces_of`` for a robot whose joints have encoders."""
    ensemble = Ensemble(model) if uncertainty else None
    unseen, last_known = Unseen(model), LastKnown(model)
    for piece, estimates in _ahead(_estimated(model, samples)):
        found = estimates
        first = piece.at(0)
        if ensemble is not None:
            if unseen.is_due(first):
                unseen.add(estimates.tension[0], estimates.status[0], first)
                ensemble.show_at_least(unseen.changes)
            else:
                unseen.end()
            unseen.note(piece.at(-1), estimates.tension, estimates.status)
            found = ensemble.follow(piece, estimates)
        stddev = NO_STDDEVS if found.stddev is None else found.stddev
        doubted = on_axes(model, piece.doubtful)
        mark_unsure(model.core, found.values, stddev, UNSURE_SHARE, doubted)
        last_known.hold(piece.unread, found.values, found.stddev)
        yield found


def _estimated(model: Model, samples: Samples) -> Iterator[tuple[Samples, Estimates]]:
    """Consecutive pieces of a pass and their estimates, without standard deviations.

    A sample after a gap is a piece, and one in which an axis is read that was not before.
    """
    state, count = initial_state(model), samples.stamp_ns.size
    after_gap, unread = np.nonzero(samples.after_gap)[0], samples.unread
    read_again = np.nonzero(unread[:-1] & ~unread[1:])[0] + 1
    gaps = {*after_gap.tolist(), *read_again.tolist()} - {0}
    ends = gaps | {k + 1 for k in gaps}
    for begin, end in pairwise(sorted({*range(0, count, AT_ONCE), *ends, count})):
        piece = samples.part(slice(begin, end))
        state, estimates = run(model, state, piece)
        yield piece, estimates


def _ahead(items: Iterator[T]) -> Iterator[T]:
    """The items, each computed by another thread while the one before it is in use.

    Estimates do not depend on standard deviations and comparisons, and the core runs without the
    interpreter's lock: with two processors, ``validate`` takes a quarter less time.
    """
    with thread_pool(1) as thread:
        coming = thread.submit(next, items, None)
        while (item := coming.result()) is not None:
            coming = thread.submit(next, items, None)
            yield item


def _pieces_encoderless(model: Model, samples: Samples, efforts: Table) -> Iterator[Estimates]:
    """``pieces_of`` for a robot with joints without encoder.

    ``efforts`` has those of the motors [N m], shape (n, motors); NaN where none was heard.
    """
    encoderless = EncoderlessEstimator(model)
    for begin in range(0, samples.stamp_ns.size, AT_ONCE):
        piece = samples.part(slice(begin, begin + AT_ONCE))
        estimates = encoderless.run(piece, efforts[begin : begin + AT_ONCE])
        stddev = NO_STDDEVS if estimates.stddev is None else estimates.stddev
        doubted = on_axes(model, piece.doubtful)
        mark_unsure(model.core, estimates.values, stddev, UNSURE_SHARE, doubted)
        yield estimates


def estimate(
    model: Model,
    conditioned: Conditioned,
    efforts: Mapping[str, Series] | None = None,
    *,
    uncertainty: bool = False,
) -> Estimates:
    """All estimates of a conditioned recording at once.

    Args:
        model: the prepared robot.
        conditioned: the recording; the estimator restarts for each of its segments.  The result
            holds the segments one after another, so its stamps go back between them.
        efforts: as for ``pieces_of``.
        uncertainty: as for ``pieces_of``.
    """
    total = sum(segment.stamp_ns.size for segment in conditioned.segments)
    stamps = np.concatenate(
        [np.empty(0, np.int64), *(segment.stamp_ns for segment in conditioned.segments)]
    )
    values = np.empty((total, model.layout.size))
    uncertainty = uncertainty or bool(model.robot.unmeasured)
    stddev = np.empty((total, stddev_columns(model.layout).size)) if uncertainty else None
    angles: list[Angles] = []
    done = 0
    for segment in conditioned.segments:
        for piece in pieces_of(model, segment, efforts, uncertainty=uncertainty):
            place = slice(done, done + piece.stamp_ns.size)
            values[place] = piece.values
            if stddev is not None:
                stddev[place] = piece.stddev
            if piece.angles is not None:
                angles.append(piece.angles)
            done = place.stop
    return Estimates(stamps, values, model.layout, stddev, _joined(angles))


def _joined(angles: Sequence[Angles]) -> Angles | None:
    """Angles one after another; None where there are none."""
    if not angles:
        return None
    value, stddev = (np.concatenate([one[k] for one in angles]) for k in (1, 2))
    return Angles(angles[0].names, value, stddev)


OUTPUTS: Final = tuple(in_namespace(one.topic) for one in ESTIMATE_MESSAGES)
"""Topics of the estimates, as the node publishes them by default."""


def write_estimates(
    out: str,
    path: str,
    log_ns: NDArray[np.int64],
    pieces: Iterable[Estimates],
    outputs: tuple[str, ...] = OUTPUTS,
) -> None:
    """Write a bag with everything in the bag at ``path``, and the estimates beside it.

    Header stamps are those of the estimates; log times follow them with the delay of the inputs.
    Messages of the original on the topics of ``outputs`` are left out, since a topic would
    otherwise hold estimates of two sources.

    Args:
        out: the bag to write.
        path: the bag that was read.
        log_ns: log times of all estimates, see ``log_times``.
        pieces: the estimates in this order; each is written before the next is asked for.
        outputs: topics of tensions, nodal forces and efforts.

    Raises:
        BagError: ``out`` exists, or one of them cannot be read or written.
    """
    done = 0

    def write(bag: BagWriter, piece: Estimates) -> None:
        nonlocal done
        end = done + piece.stamp_ns.size
        _write_piece(bag, piece, log_ns[done:end], outputs)
        done = end

    types = [one.message.name for one in ESTIMATE_MESSAGES]
    with BagWriter(out) as bag:
        kept = [name for name in open_source(path).all_channels() if name not in outputs]
        bag.copy(path, kept)
        bag.write_pieces(dict(zip(outputs, types, strict=True)), pieces, write)


def _write_piece(
    bag: BagWriter, piece: Estimates, log_ns: NDArray[np.int64], outputs: tuple[str, ...]
) -> None:
    layout, values = piece.layout, piece.values
    status = values[:, layout.status].astype(np.uint8)
    for topic, one in zip(outputs, ESTIMATE_MESSAGES, strict=True):
        arrays = {array: values[:, getattr(layout, array)] for array in one.arrays}
        if beside := one.beside(layout):
            arrays["status"] = np.bitwise_or.reduce(status[:, beside], axis=-1)
        if piece.stddev is not None and one.uncertain:
            arrays["stddev"] = piece.stddev[:, layout.stddev[one.uncertain]]
        names = one.names(layout)
        bag.write(one.message, topic, piece.stamp_ns, names, arrays, log_ns, one.frame(layout))


def log_times(recording: Recording, conditioned: Conditioned) -> NDArray[np.int64]:
    """Log time of each estimate [ns], shape (n,); never before that of the estimate before it.

    The delay from header stamp to log time is that of the first motor's (or joint's) messages,
    between which it is interpolated.

    Args:
        recording: the recorded series.
        conditioned: its samples, at whose stamps the estimates are.
    """
    readings = {**recording.motors, **recording.joints}
    first = next(iter(readings))
    series = in_order({first: readings[first]}, conditioned)[first]
    stamps = conditioned.segments[0].stamp_ns
    order = np.argsort(series.stamp_ns, kind="stable")
    at, log_ns = series.stamp_ns[order], series.log_ns[order]
    begin_ns = stamps[0]  # subtracted from stamps, so that a float holds them exactly
    delay = np.interp(
        (stamps - begin_ns).astype(np.float64), (at - begin_ns).astype(np.float64),
        (log_ns - at).astype(np.float64),
    )  # fmt: skip
    logs: NDArray[np.int64] = np.maximum.accumulate(stamps + np.rint(delay).astype(np.int64))
    return logs
