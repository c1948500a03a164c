"""A recording against the estimator: what the commands and the replay node share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.bag import BagWriter, Recording, Series, Topics, list_topics, read_recording
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.conditioning.whole_recording import Conditioned, Readings, condition
from cdrj_ros.estimation.ensemble import Spread, spread_columns
from cdrj_ros.estimation.estimator import Estimates, initial_state, run
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.judgement.comparison import (
    Angle,
    BagComparison,
    Channel,
    compare,
    one_after_another,
    summed_up,
    unknown_references,
)
from cdrj_ros.judgement.pulley_friction import PulleyFriction, pulley_friction
from cdrj_ros.judgement.reversals import clock_resets, reversal_zones
from cdrj_ros.model.prepared import Layout, Model, shape_at

MAX_GAP_NS: Final = 100_000_000
"""References are compared only between estimates at most this far apart [ns]."""

AT_ONCE: Final = 250_000
"""Samples between two reports of progress; the numbers do not depend on it."""

OUTPUTS: Final = ("/cdrj/tensions", "/cdrj/nodal_forces", "/cdrj/efforts")
"""Topics of the estimates, as the node publishes them by default."""

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


def stddev_channels(
    layout: Layout, stddev: NDArray[np.float64] | None
) -> dict[str, NDArray[np.float64]]:
    """Standard deviations by channel name; nothing where they are not known.

    Args:
        layout: names of the channels.
        stddev: of tensions, nodal forces, motor efforts and joint efforts, shape (n, channels).
    """
    if stddev is None:
        return {}
    names = [f"tension/{name}" for name in layout.elements]
    names += [f"nodal_force/{name}" for name in layout.pulleys]
    names += [f"effort/{name}" for name in (*layout.motors, *layout.joints)]
    return {name: stddev[:, k] for k, name in enumerate(names)}


def estimate(
    model: Model,
    conditioned: Conditioned,
    progress: Callable[[float], None] | None = None,
    *,
    spread: bool = False,
) -> Estimates:
    """The estimator over a conditioned recording; started anew where the clock went back.

    Args:
        model: the prepared robot.
        conditioned: the recording; its segments follow one another in the result, whose stamps go
            back between them.
        progress: told now and then which share is done, from 0 to 1.
        spread: standard deviations too, for about as much time again.
    """
    total = sum(segment.stamp_ns.size for segment in conditioned.segments)
    stamps = np.concatenate(
        [np.empty(0, np.int64), *(segment.stamp_ns for segment in conditioned.segments)]
    )
    values = np.empty((total, model.layout.size))
    stddevs = np.empty((total, spread_columns(model.layout).size)) if spread else None
    done = 0
    for segment in conditioned.segments:
        state = initial_state(model)
        ensemble = Spread(model) if spread else None
        for begin in range(0, segment.stamp_ns.size, AT_ONCE):
            piece = slice(begin, begin + AT_ONCE)
            samples = Samples(
                segment.stamp_ns[piece], segment.motor_angle[piece], segment.joint_angle[piece]
            )
            place = slice(done, done + samples.stamp_ns.size)
            if ensemble is not None and stddevs is not None:
                state, _ = ensemble.run(state, samples, values[place], stddevs[place])
            else:
                state, _ = run(model, state, samples, values[place])
            done = place.stop
            if progress:
                progress(done / total)
    return Estimates(stamps, values, model.layout, stddevs)


def log_times(recording: Recording, estimates: Estimates) -> NDArray[np.int64]:
    """When each estimate counts as recorded [ns], shape (n,): as long after its stamp as inputs.

    The delay from header stamp to log time is that of the first motor's (or joint's) messages.
    """
    series = next(iter({**recording.joints, **recording.motors}.values()))
    logs = np.empty_like(estimates.stamp_ns)
    jumps = len(_slices(estimates.stamp_ns)) - 1
    for part, own in zip(
        _slices(estimates.stamp_ns), _passes_of(series, jumps, series), strict=True
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
    if conditioned.steps:
        counts["stepped_readings"] = conditioned.steps
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
    *,
    stddev: Mapping[str, NDArray[np.float64]] | None = None,
    friction: Sequence[PulleyFriction] = (),
    window: tuple[float, float] = (0.0, float("inf")),
) -> BagComparison:
    """Estimates, wherever they came from, against the references recorded in the bag.

    Args:
        stamps: of the estimates [ns], shape (n,); where the clock went back in the recording, they
            go back likewise, and every pass is compared with the references of its own.
        channels, stddev: by channel name, shape (n,) each.
        friction: what the pulleys' friction was, for the report.
        window: seconds after the recording's begin from and to which references are compared.

    Raises:
        BagError: there is nothing to compare.
    """
    references = _windowed(recording, window)
    if not references:
        raise BagError(
            f"{path} holds no references"
            + (" in that time" if recording.references else "")
            + "; name their topics with --reference (CableTensions, NodalForces, or JointState "
            "with efforts)"
        )
    if stamps.size == 0:
        raise BagError(f"{path}: not one sample of all motors and joints was acceptable")
    parts, segments = _slices(stamps), conditioned.segments
    jumped: tuple[str, ...] = ()
    if len(segments) > 1:
        again = len(segments) - 1
        if len(parts) == len(segments):
            text = (
                f"The clock went back {again} times; each of the {len(parts)} passes is compared "
                "on its own, one drawn after the other."
            )
            jumped = (text,)
        else:
            jumped = (f"The clock went back {again} times; only what came after is compared.",)
            parts, segments = parts[-1:], segments[-1:]
    of_passes = _references_of_passes(references, recording, conditioned, len(parts))
    compared = [
        _compare_pass(model, segment, stamps[part], _cut(channels, part), given, _cut(stddev, part))
        for part, segment, given in zip(parts, segments[-len(parts) :], of_passes, strict=True)
    ]
    begin, end = window
    length = (recording.end_ns - recording.start_ns) * 1e-9
    comparison = summed_up(
        path,
        max(min(length, end) - begin, 0.0),
        one_after_another(compared),
        unknown_references(channels, references),
        counters_of(recording, conditioned),
        (*recording.notes, *notes, *jumped),
        facts,
    )
    return replace(comparison, friction=tuple(friction))


def write_estimates(
    out: str,
    path: str,
    recording: Recording,
    estimates: Estimates,
    outputs: tuple[str, str, str] = OUTPUTS,
) -> None:
    """Write a bag of everything in the bag at ``path``, with the estimates beside it.

    Header stamps are those of the estimates, log times as late after them as the inputs' were.
    What the original has on the topics of ``outputs`` is left out: estimates of two sources on one
    topic could not be told apart.

    Raises:
        BagError: ``out`` exists, or one of them cannot be read or written.
    """
    layout, values, stamps = estimates.layout, estimates.values, estimates.stamp_ns
    stddev = estimates.stddev
    deviations = np.empty((stamps.size, 0)) if stddev is None else stddev
    elements, pulleys = len(layout.elements), len(layout.pulleys)
    log_ns = log_times(recording, estimates)
    status = values[:, layout.status].astype(np.uint8)
    place = {name: k for k, name in enumerate(layout.elements)}
    after = [place[name] for name in layout.pulleys]
    before = [k - 1 for k in after]
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
            status=status[:, before] | status[:, after],
            log_ns=log_ns,
        )
        bag.write_joint_states(
            efforts,
            stamps,
            layout.motors + layout.joints,
            effort=values[:, layout.motor_effort.start : layout.joint_effort.stop],
            log_ns=log_ns,
        )


def friction_at_pulleys(estimates: Estimates) -> tuple[PulleyFriction, ...]:
    """What friction holds at every pulley, over the longest pass of a recording."""
    if not estimates.stamp_ns.size:
        return ()
    part = max(_slices(estimates.stamp_ns), key=lambda part: part.stop - part.start)
    layout, values = estimates.layout, estimates.values[part]
    return pulley_friction(
        layout,
        estimates.stamp_ns[part],
        values[:, layout.tension],
        values[:, layout.friction],
        values[:, layout.slip_speed],
    )


def _compare_pass(
    model: Model,
    segment: Samples,
    stamps: NDArray[np.int64],
    channels: Mapping[str, NDArray[np.float64]],
    references: Mapping[str, Series],
    stddev: Mapping[str, NDArray[np.float64]],
) -> tuple[Channel, ...]:
    both = np.concatenate([segment.motor_angle, segment.joint_angle], axis=1)
    return compare(
        stamps,
        channels,
        {name: (series.stamp_ns, series.value) for name, series in references.items()},
        max_gap_ns=MAX_GAP_NS,
        angle=_telling_angles(model, segment),
        stddev=stddev,
        zones=reversal_zones(segment.stamp_ns, both),
    )


def _telling_angles(model: Model, segment: Samples) -> dict[str, Angle]:
    """By channel, the joint that it is drawn over: the one that moves its cable most.

    An effort is drawn over its own motor or joint; a cable that no joint moves, over its motor.
    """
    layout, robot = model.layout, model.robot
    angles = {
        name: Angle(name, segment.stamp_ns, values[:, k])
        for names, values in (
            (layout.motors, segment.motor_angle),
            (layout.joints, segment.joint_angle),
        )
        for k, name in enumerate(names)
    }
    lowest = np.min(segment.joint_angle, axis=0)
    middle = 0.5 * (lowest + np.max(segment.joint_angle, axis=0))
    moves = np.abs(shape_at(model, middle).length_by_joint)
    reach = moves * (np.max(segment.joint_angle, axis=0) - lowest)
    by_cable = {}
    for cable in robot.cables:
        rows = [k for k, name in enumerate(layout.elements) if name.startswith(f"{cable.name}/")]
        along = reach[rows].sum(axis=0)
        winches = [node.motor for node in cable.nodes if hasattr(node, "motor")]
        if along.size and along.max() > 0.0:
            by_cable[cable.name] = angles[layout.joints[int(along.argmax())]]
        elif winches:
            by_cable[cable.name] = angles[winches[0]]
        elif layout.joints:
            by_cable[cable.name] = angles[layout.joints[0]]
    told = {f"effort/{name}": angle for name, angle in angles.items()}
    for prefix, names in (("tension", layout.elements), ("nodal_force", layout.pulleys)):
        for name in names:
            cable_name = name.rpartition("/")[0]
            if cable_name in by_cable:
                told[f"{prefix}/{name}"] = by_cable[cable_name]
    if len(layout.joints) == 1:  # a motor's angle lags by its friction: the joint tells more
        told |= {f"effort/{name}": angles[layout.joints[0]] for name in layout.motors}
    return told


def _windowed(recording: Recording, window: tuple[float, float]) -> Mapping[str, Series]:
    """The references of a stretch of time; nothing of those that have none there."""
    begin, end = window
    if begin <= 0.0 and end == float("inf"):
        return recording.references
    kept = {}
    for name, series in recording.references.items():
        since = (series.log_ns - recording.start_ns) * 1e-9
        inside = (since >= begin) & (since < end)
        if inside.any():
            kept[name] = Series(
                series.stamp_ns[inside], series.log_ns[inside], series.value[inside]
            )
    return kept


def _cut(
    channels: Mapping[str, NDArray[np.float64]] | None, part: slice
) -> dict[str, NDArray[np.float64]]:
    return {name: values[part] for name, values in (channels or {}).items()}


def _starts(stamps: NDArray[np.int64]) -> NDArray[np.intp]:
    """Where stamps go back, shape (k,)."""
    return np.flatnonzero(np.diff(stamps) <= 0) + 1


def _slices(stamps: NDArray[np.int64]) -> list[slice]:
    """The passes of stamps that go back between them."""
    edges = [0, *_starts(stamps).tolist(), stamps.size]
    return [slice(a, b) for a, b in pairwise(edges)]


def _references_of_passes(
    references: Mapping[str, Series], recording: Recording, conditioned: Conditioned, passes: int
) -> list[dict[str, Series]]:
    """The references of every pass: those of the same turn of the clock."""
    if len(conditioned.segments) == 1:
        return [dict(references)]
    clock = next(iter({**recording.joints, **recording.motors}.values()))
    jumps = len(conditioned.segments) - 1
    given = [
        dict(zip(references, column, strict=True))
        for column in zip(
            *(_passes_of(series, jumps, clock) for series in references.values()), strict=True
        )
    ]
    return given[-passes:]


def _passes_of(series: Series, jumps: int, clock: Series) -> list[Series]:
    """A series cut where its clock went back, into one more part than there are jumps.

    Where its own stamps do not show as many jumps, the log times of those of ``clock`` count; where
    these do not either, all of it is in every part, and stamps alone decide.
    """
    at = clock_resets(series.stamp_ns)
    if len(at) != jumps:
        others = clock_resets(clock.stamp_ns)
        if len(others) != jumps:
            return [series] * (jumps + 1)
        at = np.searchsorted(series.log_ns, clock.log_ns[others])
    edges = [0, *at.tolist(), series.stamp_ns.size]
    return [
        Series(series.stamp_ns[a:b], series.log_ns[a:b], series.value[a:b])
        for a, b in pairwise(edges)
    ]


def robot_summary(model: Model) -> str:
    """The robot and its parameters in a sentence or two."""
    robot = model.robot
    cables = "; ".join(
        f"{cable.name}: {len(cable.nodes) - 1} elements, preload {cable.preload:g} N, "
        f"EA {cable.axial_stiffness:.4g} N, {cable.law}"
        for cable in robot.cables
    )
    return f"{robot.name} ({robot.source}). {cables}."
