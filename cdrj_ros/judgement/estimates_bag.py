"""Writing a copy of a recording that also holds the estimates."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.bag import BagWriter, Recording, list_topics
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


def write_estimates(
    out: str,
    path: str,
    recording: Recording,
    stamps: NDArray[np.int64],
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
        recording: its recorded series.
        stamps: of all estimates [ns], shape (n,); they go back where a pass begins.
        pieces: the estimates in this order; each is written before the next is asked for.
        outputs: topics of tensions, nodal forces and efforts.

    Raises:
        BagError: ``out`` exists, or one of them cannot be read or written.
    """
    log_ns = log_times(recording, stamps)
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


def log_times(recording: Recording, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Log time of each estimate [ns], shape (n,); never before that of the estimate before it.

    The delay from header stamp to log time is that of the first motor's (or joint's) messages.

    Args:
        recording: the recorded series.
        stamps: of the estimates [ns], shape (n,); they go back where a pass begins.
    """
    series = next(iter({**recording.joints, **recording.motors}.values()))
    logs = np.empty_like(stamps)
    parts = slices_of(stamps)
    for part, own in zip(parts, passes_of(series, len(parts) - 1, series), strict=True):
        within = stamps[part]
        in_order = np.argsort(own.stamp_ns, kind="stable")
        begin = int(within[0])
        delay = np.interp(
            (within - begin).astype(np.float64),
            (own.stamp_ns[in_order] - begin).astype(np.float64),
            (own.log_ns - own.stamp_ns)[in_order].astype(np.float64),
        )
        logs[part] = within + np.rint(delay).astype(np.int64)
    return np.maximum.accumulate(logs)
