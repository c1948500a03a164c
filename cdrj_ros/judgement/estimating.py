"""Estimation over a conditioned recording, in pieces that fit into memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, TypeVar

import numpy as np

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.conditioning.whole_recording import Conditioned
from cdrj_ros.estimation.encoderless import EncoderlessEstimator, Table
from cdrj_ros.estimation.ensemble import (
    UNSURE_SHARE,
    Ensemble,
    mark_recording,
    preload_of_elements,
    stddev_columns,
)
from cdrj_ros.estimation.estimator import Estimates, initial_state, run
from cdrj_ros.foundation.threads import thread_pool
from cdrj_ros.judgement.pulley_friction import BLOCK
from cdrj_ros.model.prepared import Model

T = TypeVar("T")

AT_ONCE: Final = 2 * BLOCK
"""Number of samples in a piece; it does not affect the estimates."""

UNKNOWN: Final = np.empty((0, 0))
"""Standard deviations that are not estimated."""


def pieces_of(model: Model, samples: Samples, *, spread: bool = False) -> Iterator[Estimates]:
    """Estimate a pass from the initial state; yields the estimates of AT_ONCE samples at a time.

    The status is what a node with default parameters publishes for the same readings.

    Args:
        model: the prepared robot.
        samples: of one pass.
        spread: whether to estimate standard deviations, which about doubles the time.
    """
    preload, ensemble = preload_of_elements(model.robot), Ensemble(model) if spread else None
    for piece, estimates in _ahead(_estimated(model, samples)):
        found = estimates if ensemble is None else ensemble.follow(piece, estimates)
        stddev = UNKNOWN if found.stddev is None else found.stddev
        mark_recording(found.values, preload, stddev, UNSURE_SHARE, piece.doubtful)
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


def pieces_alone(model: Model, samples: Samples, efforts: Table) -> Iterator[Estimates]:
    """As ``pieces_of``, for a robot with joints without encoder.

    Args:
        model: the prepared robot.
        samples: of one pass, with the joints that have encoders.
        efforts: of the motors [N m], shape (n, motors); NaN where none was heard.
    """
    alone, preload = EncoderlessEstimator(model), preload_of_elements(model.robot)
    for begin in range(0, samples.stamp_ns.size, AT_ONCE):
        piece = samples.part(slice(begin, begin + AT_ONCE))
        estimates = alone.run(piece, efforts[begin : begin + AT_ONCE])
        stddev = UNKNOWN if estimates.stddev is None else estimates.stddev
        mark_recording(estimates.values, preload, stddev, UNSURE_SHARE, piece.doubtful)
        yield estimates


def estimate(
    model: Model,
    conditioned: Conditioned,
    progress: Callable[[float], None] | None = None,
    *,
    spread: bool = False,
) -> Estimates:
    """All estimates of a conditioned recording at once.

    Args:
        model: the prepared robot.
        conditioned: the recording; the estimator restarts for each of its segments.  The result
            holds the segments one after another, so its stamps go back between them.
        progress: called with the completed fraction, from 0 to 1.
        spread: whether to estimate standard deviations, which about doubles the time.
    """
    total = sum(segment.stamp_ns.size for segment in conditioned.segments)
    stamps = np.concatenate(
        [np.empty(0, np.int64), *(segment.stamp_ns for segment in conditioned.segments)]
    )
    values = np.empty((total, model.layout.size))
    stddev = np.empty((total, stddev_columns(model.layout).size)) if spread else None
    done = 0
    for segment in conditioned.segments:
        for piece in pieces_of(model, segment, spread=spread):
            place = slice(done, done + piece.stamp_ns.size)
            values[place] = piece.values
            if stddev is not None:
                stddev[place] = piece.stddev
            done = place.stop
            if progress:
                progress(done / total)
    return Estimates(stamps, values, model.layout, stddev)
