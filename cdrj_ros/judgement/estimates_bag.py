"""Writing a copy of a recording that also holds the estimates."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.bag import BagWriter, Recording, list_topics
from cdrj_ros.estimation.estimator import Estimates
from cdrj_ros.judgement.passes import passes_of, slices_of

OUTPUTS: Final = ("/cdrj/tensions", "/cdrj/nodal_forces", "/cdrj/efforts")
"""Topics of the estimates, as the node publishes them by default."""


def write_estimates(
    out: str,
    path: str,
    recording: Recording,
    estimates: Estimates,
    outputs: tuple[str, str, str] = OUTPUTS,
) -> None:
    """Write a bag that holds the messages of the bag at ``path`` and the estimates.

    Header stamps are those of the estimates; log times are later by the delay of the inputs.
    Messages of the original on the topics of ``outputs`` are not copied, because these topics would
    otherwise hold estimates from two sources.

    Raises:
        BagError: ``out`` exists, or a bag cannot be read or written.
    """
    layout, values, stamps = estimates.layout, estimates.values, estimates.stamp_ns
    stddev = estimates.stddev
    deviations = np.empty((stamps.size, 0)) if stddev is None else stddev
    elements, pulleys = len(layout.elements), len(layout.pulleys)
    log_ns = log_times(recording, estimates)
    status = values[:, layout.status].astype(np.uint8)
    tensions, forces, efforts = outputs
    with BagWriter(out) as bag:
        kept = [topic.name for topic in list_topics(path) if topic.name not in outputs]
        bag.copy(path, kept)
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
            force_z=np.zeros((stamps.size, pulleys)),
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


def log_times(recording: Recording, estimates: Estimates) -> NDArray[np.int64]:
    """Log time of each estimate [ns], shape (n,).

    The delay from header stamp to log time is that of the first motor's (or joint's) messages.
    """
    series = next(iter({**recording.joints, **recording.motors}.values()))
    logs = np.empty_like(estimates.stamp_ns)
    jumps = len(slices_of(estimates.stamp_ns)) - 1
    for part, own in zip(
        slices_of(estimates.stamp_ns), passes_of(series, jumps, series), strict=True
    ):
        stamps = estimates.stamp_ns[part]
        in_order = np.argsort(own.stamp_ns, kind="stable")
        begin = int(stamps[0])
        delay = np.interp(
            (stamps - begin).astype(np.float64),
            (own.stamp_ns[in_order] - begin).astype(np.float64),
            (own.log_ns - own.stamp_ns)[in_order].astype(np.float64),
        )
        logs[part] = stamps + np.rint(delay).astype(np.int64)
    return logs
