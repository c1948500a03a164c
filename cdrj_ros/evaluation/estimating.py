"""Estimation over a conditioned recording, in pieces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, TypeVar

import numpy as np

from cdrj_ros._core import mark_unsure
from cdrj_ros.estimation.encoderless import EncoderlessEstimator, efforts_at
from cdrj_ros.estimation.ensemble import (
    UNSURE_SHARE,
    Ensemble,
    preload_of_elements,
    stddev_columns,
)
from cdrj_ros.estimation.estimator import Angles, Estimates, initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.estimation.whole_recording import Conditioned
from cdrj_ros.foundation.arrays import Series, Table
from cdrj_ros.foundation.interruption import thread_pool
from cdrj_ros.model.prepared import Model

T = TypeVar("T")

AT_ONCE: Final = 8192
"""Number of samples in a piece, which fit into the processor's cache; no estimate depends on it."""

UNKNOWN: Final = np.empty((0, 0))
"""Standard deviations that are not estimated."""


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
    preload, ensemble = preload_of_elements(model.robot), Ensemble(model) if uncertainty else None
    for piece, estimates in _ahead(_estimated(model, samples)):
        found = estimates if ensemble is None else ensemble.follow(piece, estimates)
        stddev = UNKNOWN if found.stddev is None else found.stddev
        mark_unsure(found.values, preload, stddev, UNSURE_SHARE, piece.doubtful)
        yield found


def _estimated(model: Model, samples: Samples) -> Iterator[tuple[Samples, Estimates]]:
    """Consecutive pieces of a pass and their estimates, without standard deviations."""
    state = initial_state(model)
    for begin in range(0, samples.stamp_ns.size, AT_ONCE):
        piece = samples.part(slice(begin, begin + AT_ONCE))
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
    encoderless, preload = EncoderlessEstimator(model), preload_of_elements(model.robot)
    for begin in range(0, samples.stamp_ns.size, AT_ONCE):
        piece = samples.part(slice(begin, begin + AT_ONCE))
        estimates = encoderless.run(piece, efforts[begin : begin + AT_ONCE])
        stddev = UNKNOWN if estimates.stddev is None else estimates.stddev
        mark_unsure(estimates.values, preload, stddev, UNSURE_SHARE, piece.doubtful)
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
