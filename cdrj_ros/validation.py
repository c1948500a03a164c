"""A recording against the estimator: what the commands and the replay node share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.bag import Recording, Series, Topics, read_recording
from cdrj_ros.estimation.comparison import Angle, BagComparison, compare_bag
from cdrj_ros.estimation.conditioning import Conditioned, Readings, condition
from cdrj_ros.estimation.estimator import Estimates, initial_state, run
from cdrj_ros.model.errors import BagError
from cdrj_ros.model.plan import Layout, Model

MAX_GAP_NS: Final = 100_000_000
"""References are compared only between estimates at most this far apart [ns]."""

PUBLISHED: Final[Mapping[str, str]] = {
    "tension/upper/8": "1.10 N, 4.44 %",
    "tension/lower/8": "1.10 N, 4.44 %",
    "nodal_force/upper/3": "2.68 N, 6.74 %",
    "nodal_force/lower/3": "2.68 N, 6.74 %",
}
"""Errors that the source reports for its own rig at preloads of 36.85 and 26.26 N."""

PUBLISHED_HEADING: Final = "source, own rig"


def read_inputs(path: str, topics: Topics, model: Model) -> Recording:
    """Read a bag for a robot.

    Raises:
        BagError: as ``read_recording``.
    """
    layout = model.layout
    recording = read_recording(path, topics)
    for kind, wanted, there in (
        ("motor", layout.motors, recording.motors),
        ("joint", layout.joints, recording.joints),
    ):
        missing = [name for name in wanted if name not in there]
        if missing:
            raise BagError(
                f"{path} has no {kind} named {', '.join(missing)}; "
                f"it has {', '.join(sorted(there)) or 'none'}"
            )
    return recording


def condition_recording(model: Model, recording: Recording) -> Conditioned:
    """The recording's readings through the same gates as the node's.

    Where motors and joints share a topic, a stranger's name counts once.
    """
    joints = recording.joints
    if set(joints) == set(recording.motors):
        joints = {name: joints[name] for name in model.layout.joints}
    return condition(model.robot, _readings(recording.motors), _readings(joints))


def _readings(channels: Mapping[str, Series]) -> dict[str, Readings]:
    return {
        name: Readings(series.stamp_ns, series.log_ns, series.value)
        for name, series in channels.items()
    }


def estimate_channels(
    layout: Layout, values: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Estimates by channel name, as the comparison and the bags call them.

    Args:
        layout: places in the estimate.
        values: shape (n, layout.size).
    """
    named = {}
    for prefix, names, where in (
        ("tension", layout.elements, layout.tension),
        ("nodal_force", layout.pulleys, layout.magnitude),
        ("effort", layout.motors, layout.motor_effort),
        ("effort", layout.joints, layout.joint_effort),
    ):
        for k, name in enumerate(names):
            named[f"{prefix}/{name}"] = values[:, where.start + k]
    return named


def estimate(model: Model, conditioned: Conditioned) -> Estimates:
    """The estimator over a conditioned recording; started anew where the clock went back."""
    parts = [run(model, initial_state(model), segment)[1] for segment in conditioned.segments]
    if not parts:
        return Estimates(np.empty(0, np.int64), np.empty((0, model.layout.size)), model.layout)
    if len(parts) == 1:
        return parts[0]
    return parts[-1]  # after a jump of the clock only one pass can be told apart by stamps


def counters_of(recording: Recording, conditioned: Conditioned) -> dict[str, int]:
    """What was refused, by cause; zero counts left out."""
    counts = {cause: n for cause, n in conditioned.refused.items() if n}
    malformed = sum(recording.malformed.values())
    if malformed:
        counts["malformed"] = counts.get("malformed", 0) + malformed
    if conditioned.clock_jumps:
        counts["clock_jumps"] = conditioned.clock_jumps
    if conditioned.gaps:
        counts["gaps"] = conditioned.gaps
    return counts


def compare_with_references(
    model: Model,
    path: str,
    recording: Recording,
    conditioned: Conditioned,
    stamps: NDArray[np.int64],
    channels: Mapping[str, NDArray[np.float64]],
    facts: Mapping[str, str] | None = None,
    notes: tuple[str, ...] = (),
) -> BagComparison:
    """Estimates, wherever they came from, against the references recorded in the bag.

    Raises:
        BagError: there is nothing to compare.
    """
    if not recording.references:
        raise BagError(
            f"{path} holds no references; name their topics with --reference (CableTensions, "
            "NodalForces, or JointState with efforts)"
        )
    if stamps.size == 0:
        raise BagError(f"{path}: not one sample of all motors and joints was acceptable")
    angle = None
    if model.layout.joints and conditioned.segments:
        segment = conditioned.segments[-1]
        angle = Angle(model.layout.joints[0], segment.stamp_ns, segment.joint_angle[:, 0])
    jumped: tuple[str, ...] = ()
    if len(conditioned.segments) > 1:
        again = len(conditioned.segments) - 1
        jumped = (f"The clock went back {again} times; only what came after is compared.",)
    return compare_bag(
        path,
        (recording.end_ns - recording.start_ns) * 1e-9,
        stamps,
        channels,
        {name: (series.stamp_ns, series.value) for name, series in recording.references.items()},
        max_gap_ns=MAX_GAP_NS,
        angle=angle,
        counters=counters_of(recording, conditioned),
        notes=(*recording.notes, *notes, *jumped),
        facts=facts,
    )


def robot_summary(model: Model) -> str:
    """The robot and its parameters in a sentence or two."""
    robot = model.robot
    cables = "; ".join(
        f"{cable.name}: {len(cable.nodes) - 1} elements, preload {cable.preload:g} N, "
        f"EA {cable.axial_stiffness:.4g} N, {cable.law}"
        for cable in robot.cables
    )
    return f"{robot.name} ({robot.source}). {cables}."
