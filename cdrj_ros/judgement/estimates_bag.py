"""Writing a copy of a recording that also holds the estimates."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.bag import BagWriter, Recording, list_topics
from cdrj_ros.conditioning.whole_recording import Conditioned
from cdrj_ros.estimation.estimator import Estimates
from cdrj_ros.judgement.passes import passes_of, slices_of
from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES

OUTPUTS: Final = (
    topics.in_namespace(topics.TENSIONS),
    topics.in_namespace(topics.NODAL_FORCES),
    topics.in_namespace(topics.EFFORTS),
)
"""Topics of the estimates, as the node publishes them by default."""

AT_ONCE: Final = 65_536
"""Log times computed at a time; it does not affect them."""


def write_estimates(
    out: str,
    path: str,
    log_ns: NDArray[np.int64],
    pieces: Iterable[Estimates],
    outputs: tuple[str, str, str] = OUTPUTS,
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

    types = (CABLE_TENSIONS.name, NODAL_FORCES.name, JOINT_STATE.name)
    with BagWriter(out) as bag:
        kept = [topic.name for topic in list_topics(path) if topic.name not in outputs]
        bag.copy(path, kept)
        bag.write_pieces(dict(zip(outputs, types, strict=True)), pieces, write)


def _write_piece(
    bag: BagWriter, piece: Estimates, log_ns: NDArray[np.int64], outputs: tuple[str, str, str]
) -> None:
    layout, values, stamps, stddev = piece.layout, piece.values, piece.stamp_ns, piece.stddev
    deviations = np.empty((stamps.size, 0)) if stddev is None else stddev
    elements, pulleys = len(layout.elements), len(layout.pulleys)
    status = values[:, layout.status].astype(np.uint8)
    tensions, forces, efforts = outputs
    bag.write_tensions(
        tensions,
        stamps,
        layout.elements,
        values[:, layout.tension],
        None if stddev is None else deviations[:, :elements],
        status,
        log_ns=log_ns,
    )
    bag.write_nodal_forces(
        forces,
        stamps,
        layout.pulleys,
        values[:, layout.magnitude],
        force_x=values[:, layout.force_x],
        force_y=values[:, layout.force_y],
        force_z=values[:, layout.force_z],
        stddev=None if stddev is None else deviations[:, elements : elements + pulleys],
        friction=values[:, layout.friction],
        slip_speed=values[:, layout.slip_speed],
        status=layout.pulley_status(status),
        log_ns=log_ns,
    )
    bag.write_joint_states(
        efforts,
        stamps,
        layout.motors + layout.joints,
        effort=values[:, layout.motor_effort.start : layout.joint_effort.stop],
        log_ns=log_ns,
    )


def log_times(recording: Recording, conditioned: Conditioned) -> NDArray[np.int64]:
    """Log time of each estimate [ns], shape (n,); never before that of the estimate before it.

    The delay from header stamp to log time is that of the first motor's (or joint's) messages.

    Args:
        recording: the recorded series.
        conditioned: its samples, at whose stamps the estimates are.
    """
    series = next(iter({**recording.joints, **recording.motors}.values()))
    segments = [segment.stamp_ns for segment in conditioned.segments]
    stamps = np.concatenate([np.empty(0, np.int64), *segments])
    logs = np.empty_like(stamps)
    parts = slices_of(stamps)
    for part, own in zip(parts, passes_of(series, len(parts) - 1, series), strict=True):
        readings, log_ns = own.stamp_ns, own.log_ns
        if np.any(readings[1:] < readings[:-1]):
            in_order = np.argsort(readings, kind="stable")
            readings, log_ns = readings[in_order], log_ns[in_order]
        for begin in range(part.start, part.stop, AT_ONCE):
            piece = slice(begin, min(begin + AT_ONCE, part.stop))
            delay = _delay_at(stamps[piece], readings, log_ns, int(stamps[part.start]))
            logs[piece] = stamps[piece] + np.rint(delay).astype(np.int64)
    np.maximum.accumulate(logs, out=logs)
    return logs


def _delay_at(
    stamps: NDArray[np.int64],
    readings: NDArray[np.int64],
    log_ns: NDArray[np.int64],
    begin_ns: int,
) -> NDArray[np.float64]:
    """Delay from stamp to log time [ns], between the neighbouring readings, shape of ``stamps``.

    Args:
        stamps: increasing [ns], at least one.
        readings, log_ns: stamps, in order, and log times of all readings [ns].
        begin_ns: time that is subtracted from stamps, so that a float holds them exactly.
    """
    first = max(int(np.searchsorted(readings, stamps[0], side="right")) - 1, 0)
    near = slice(first, int(np.searchsorted(readings, stamps[-1])) + 1)
    delay: NDArray[np.float64] = np.interp(
        (stamps - begin_ns).astype(np.float64),
        (readings[near] - begin_ns).astype(np.float64),
        (log_ns[near] - readings[near]).astype(np.float64),
    )
    return delay
