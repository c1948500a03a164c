"""Validation: estimation over a recording, and comparison with its references."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from time import perf_counter
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.estimation.conditioner import Conditioned
from cdrj_ros.estimation.estimator import Angles, Estimates, on_axes
from cdrj_ros.evaluation.channels import (
    ANGLE,
    BagComparison,
    Channel,
    FrictionSums,
    estimate_channels,
    plot_angles,
    stddev_channels,
)
from cdrj_ros.evaluation.comparison import Comparing
from cdrj_ros.evaluation.estimating import OUTPUTS, log_times, pieces_of, write_estimates
from cdrj_ros.evaluation.inputs import (
    MISFIT,
    WHOLE,
    Window,
    condition_recording,
    counters_of,
    doubts_of,
    duration_s,
    in_frames_of,
    in_order,
    nothing_beside,
    read_encoderless,
    read_inputs,
    references_in,
    require_references,
    unstated_counts,
    with_estimated_joints,
)
from cdrj_ros.evaluation.recorded_verdict import RecordedVerdict
from cdrj_ros.foundation.arrays import Floats, Series
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.messages.topics import TENSION_SENSORS, in_namespace
from cdrj_ros.model.packing import EFFORT, OK, TENSION
from cdrj_ros.model.prepared import Model, load_model
from cdrj_ros.recordings.recording import Recording, Topics, read_recording
from cdrj_ros.recordings.source import open_source
from cdrj_ros.recordings.table import Columns

MAX_GAP_NS: Final = 100_000_000
"""References are compared only between estimates at most this far apart [ns]."""

PRELOAD_DIFFERS: Final = 0.1
"""Relative difference of all mean tensions of a cable beyond which its preload is questioned."""

NO_PRELOAD: Final = 5.0
"""Ratio of mean tensions, or its inverse, beyond which another preload is not the reason."""

EFFORT_DIFFERS: Final = 3.0
"""Ratio of efforts, or its inverse, beyond which their unit or sign is questioned."""

LEFT: Final = 0.25
"""Share of the square of efforts that may be left where another unit or sign is the reason."""


Progress = Callable[[float], None]


class Sensors(NamedTuple):
    """Readings of sensors, which are compared with what the robot file says."""

    efforts: Mapping[str, Series]
    """Of the motors by name [N m]."""
    cells: Mapping[str, Series]
    """Tensions by element [N]."""


class Validation:
    """Estimates of a recording, in pieces, that are compared with its references."""

    def __init__(
        self,
        model: Model,
        path: str,
        recording: Recording,
        conditioned: Conditioned,
        *,
        window: Window = WHOLE,
        sensors: Sensors | None = None,
    ) -> None:
        """Choose the references.

        Args:
            model: the prepared robot.
            path: the recording, as the user named it.
            recording: the recorded series.
            conditioned: its samples, at whose stamps the estimates are; one segment.
            window: time interval of the references that are compared.
            sensors: readings for a verdict on the robot; None or none at all: there is none.

        Raises:
            BagError: there is nothing to compare.
        """
        heard = [in_order(one, conditioned) for one in sensors or ()]
        self._verdict = RecordedVerdict(model, *heard) if any(heard) else None
        recording = in_frames_of(model.robot, recording)
        references = references_in(model, path, recording, conditioned, window)
        self._model, self._path, self._recording = model, path, recording
        self._conditioned, self._window = conditioned, window
        self._friction = FrictionSums(model.layout)
        names = list(estimate_channels(model.layout, np.empty((0, model.layout.size))))
        names += [f"{ANGLE}/{model.layout.joints[j]}" for j in model.robot.unmeasured]
        self._unknown = [name for name in references if name not in names]
        (self._segment,) = conditioned.segments
        self._comparing = Comparing(names, self._segment.stamp_ns, references, MAX_GAP_NS)
        self._angles: list[Angles] = []
        self._judged = self._ok = 0

    def compare(
        self, pieces: Iterable[Estimates], progress: Progress | None = None
    ) -> Iterator[Estimates]:
        """Compare; exhaust it once, before ``result``.

        Args:
            pieces: consecutive estimates, which are not stored otherwise.
            progress: called with the completed fraction, from 0 to 1.

        Yields:
            The same pieces.
        """
        segment, done = self._segment, 0
        for piece in pieces:
            if piece.angles is not None:
                self._angles.append(piece.angles)
            self._friction.add(piece.values)
            if piece.stddev is not None:
                self._judged += int(np.count_nonzero(np.isfinite(piece.status)))
                self._ok += int(np.count_nonzero(piece.status == OK))
            end = done + piece.stamp_ns.size
            samples = segment.part(slice(done, end))
            known = _known(piece, on_axes(self._model, samples.unread), self._model.touched)
            self._comparing.add(*_by_channel(known), piece.stamp_ns.size)
            if self._verdict:
                self._verdict.follow(samples)
            yield piece
            done = end
            if progress:
                progress(done / segment.stamp_ns.size)

    def result(self, facts: Mapping[str, str], notes: Sequence[str] = ()) -> BagComparison:
        """The comparison of all pieces, for which ``compare`` must have been exhausted.

        Args:
            facts: further facts for the reader, by label.
            notes: remarks for the reader.
        """
        model, segment, recording = self._model, self._segment, self._recording
        if self._angles:
            segment = with_estimated_joints(model.robot, segment, self._angles)
        channels = self._comparing.channels(plot_angles(model, segment))
        counters = Counter(counters_of(recording, self._conditioned))
        for channel in channels:
            counters.update(channel.dropped)
        remarks = [*recording.notes, *notes]
        if not any(note.startswith(MISFIT) for note in notes):
            remarks += [*_preload_notes(model, channels), *_effort_notes(model, channels)]
        if self._unknown:
            names = ", ".join(self._unknown)
            remarks.append(f"Recorded but not estimated, so not compared: {names}.")
        if silent := [channel.name for channel in channels if len(channel.stamp_ns) == 0]:
            remarks.append(f"No reference sample has an estimate beside it: {', '.join(silent)}.")
        return BagComparison(
            self._path, duration_s(recording, self._window), channels, dict(counters),
            tuple(remarks), facts, self._friction.result(),
            self._verdict.verdict() if self._verdict else None, self._judged, self._ok,
        )  # fmt: skip


def _effort_notes(model: Model, channels: Iterable[Channel]) -> list[str]:
    """Notes on efforts of another sign or unit than estimated."""
    notes, axes = [], {f"{EFFORT}/{axis.name}": axis for axis in model.robot.axes}
    for channel in channels:
        squares = float(np.sum(np.square(channel.estimate)))
        if channel.name not in axes or squares == 0.0:
            continue
        axis = axes[channel.name]
        ratio = float(np.sum(channel.reference * channel.estimate)) / squares
        whole = float(np.sum(np.square(channel.reference)))
        if whole - ratio**2 * squares > LEFT * whole:
            continue
        if ratio < -1.0 / EFFORT_DIFFERS:
            fits = f"effort_sign: {-axis.effort_sign:+d}"
        elif ratio > EFFORT_DIFFERS or 0.0 < ratio < 1.0 / EFFORT_DIFFERS:
            fits = f"effort_scale: {axis.effort_scale / ratio:.4g}"
        else:
            continue
        notes.append(f"{axis.name} {ratio:.3g} times, {fits} fits")
    return [f"Recorded efforts by the estimates: {'; '.join(notes)}."] if notes else []


def _known(piece: Estimates, gone: NDArray[np.bool_], touched: NDArray[np.bool_]) -> Estimates:
    """Estimates with NaN where nothing is known of elements, which is not compared."""
    if not gone.size:
        return piece
    layout, known = piece.layout, replace(piece, values=piece.values.copy())
    known.tension[gone] = known.values[:, layout.effort][gone @ touched.T] = np.nan
    for force in (known.force_x, known.force_y, known.force_z, known.nodal_force):
        force[gone[:, layout.element_before]] = np.nan
    return known


def _by_channel(piece: Estimates) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Estimates and standard deviations by channel name."""
    estimates = estimate_channels(piece.layout, piece.values)
    stddev = stddev_channels(piece.layout, piece.stddev)
    if piece.angles is not None:
        for k, name in enumerate(piece.angles.names):
            estimates[f"{ANGLE}/{name}"] = piece.angles.value[:, k]
            stddev[f"{ANGLE}/{name}"] = piece.angles.stddev[:, k]
    return estimates, stddev


def _preload_notes(model: Model, channels: Iterable[Channel]) -> list[str]:
    """Notes on cables whose recorded tensions are all larger or all smaller than estimated."""
    notes = []
    for cable in model.robot.cables:
        means = [
            (float(np.mean(channel.reference)), float(np.mean(channel.estimate)))
            for channel in channels
            if channel.name.startswith(f"{TENSION}/{cable.name}/") and channel.reference.size
        ]
        slack = cable.slack_tension
        recorded = [mean for mean, estimate in means if mean > slack >= estimate]
        ratios = [mean / estimate for mean, estimate in means if estimate > slack]
        if recorded:
            notes.append(
                f"Cable {cable.name} is slack by the estimates, where {max(recorded):.3g} N were "
                "recorded: its preload, or zeros of joints? commission takes the tare."
            )
        elif not ratios:
            continue
        elif min(ratios) < 1.0 / NO_PRELOAD or max(ratios) > NO_PRELOAD:
            notes.append(
                f"Recorded tensions of cable {cable.name} are {np.mean(ratios):.3g} times the "
                "estimates on average: another column, unit or sign?"
            )
        elif min(ratios) > 1.0 + PRELOAD_DIFFERS or max(ratios) < 1.0 - PRELOAD_DIFFERS:
            notes.append(
                f"Recorded tensions of cable {cable.name} are {100.0 * np.mean(ratios):.0f} % of "
                f"the estimates on average; its preload is {cable.preload:.4g} N here. If "
                "the recording had another one, give it with --preload."
            )
    return notes


LOAD_CELLS: Final = in_namespace(TENSION_SENSORS)
"""Topic of the load cells in the default namespace."""

READING_SHARE: Final = 0.3
"""Share of the processing time of a bag that reading takes, for the progress display."""

Health = Literal["auto", "references", "off"]
HEALTH: Final[tuple[Health, ...]] = get_args(Health)
"""Sensors that judge the robot: those that the node would hear, references too, or none."""


@dataclass(frozen=True)
class BagTask:
    """The work on one bag, with everything that another process needs for it."""

    path: str
    """The bag or table, as the user named it."""
    topics: Topics | Columns
    robot: str = ""
    """The robot file."""
    preload: str | None = None
    """Preloads that replace those of the robot file."""
    window: Window = WHOLE
    outputs: tuple[str, ...] = OUTPUTS
    """Topics of the estimates in the written bag."""
    uncertainty: bool = False
    """Whether standard deviations are computed."""
    written: str = ""
    """Bag to write with the original messages and the estimates; empty for none."""
    health: Health = "off"
    """Sensors that judge the robot: those that the node would hear, or also the references."""
    load_cells: str = LOAD_CELLS
    """Topic of the load cells that the node would hear."""
    read: Recording | None = None
    """What was read, if anything was."""


prepared_model = cache(load_model)
"""The model of a robot file with preloads, loaded once per process."""


def validate_bag(
    model: Model, bag: str | Recording, topics: Topics | Columns, uncertainty: bool = False
) -> BagComparison:
    """``compare_bag`` with a given model; ``uncertainty`` requests standard deviations."""
    read = bag if isinstance(bag, Recording) else None
    path = str(bag.path) if isinstance(bag, Recording) else bag
    return compare_bag(BagTask(path, topics, uncertainty=uncertainty, read=read), model=model)


def compare_bag(
    task: BagTask, progress: Progress | None = None, model: Model | None = None
) -> BagComparison:
    """Run the estimator on one bag and compare it with the bag's references.

    Args:
        task: the work.
        progress: called with the completed fraction, from 0 to 1.
        model: the prepared robot; by default that of the task's robot file.

    Raises:
        BagError: the bag cannot be read or has nothing to compare.
        RobotFileError: the robot file describes no possible robot.
    """
    model = model or prepared_model(task.robot, task.preload)
    begin = perf_counter()
    recording, sensors = _read(task, model)
    require_references(task.path, task.topics, recording)
    conditioned = condition_recording(model, recording)
    log_ns = log_times(recording, conditioned) if task.written else None
    notes = [*doubts_of(model, conditioned), *unstated_counts(model, recording)]
    recording = replace(recording, motors={}, joints={})  # one hour of readings is 130 MB
    reading_s = perf_counter() - begin
    if progress:
        progress(READING_SHARE)

    def on(share: float) -> None:
        if progress:
            progress(READING_SHARE + (1.0 - READING_SHARE) * share)

    begin = perf_counter()
    validation = Validation(
        model, task.path, recording, conditioned, window=task.window, sensors=sensors
    )
    motor_efforts = in_order(recording.motor_efforts, conditioned)
    (segment,) = conditioned.segments
    estimated = pieces_of(model, segment, motor_efforts, uncertainty=task.uncertainty)
    pieces = validation.compare(estimated, on)
    if log_ns is not None:
        write_estimates(task.written, task.path, log_ns, pieces, task.outputs)
    else:
        for _ in pieces:
            pass
    facts = {
        "samples": f"{segment.stamp_ns.size}",
        "time": f"{reading_s:.2f} s reading, {perf_counter() - begin:.2f} s estimating",
        "path": "offline, in lock-step",
    }
    if task.preload is not None:
        facts["preload"] = f"{task.preload} N"
    if jumps := conditioned.clock_jumps:
        notes.append(f"The clock went back {jumps} times; the longest part between was compared.")
    found = validation.result(facts, notes)
    if not found.compared:
        raise BagError(f"{task.path}: {nothing_beside(segment.stamp_ns, recording.references)}")
    return found


def _read(task: BagTask, model: Model) -> tuple[Recording, Sensors | None]:
    """The recording, and the readings for a verdict on the robot, if there are any."""
    bag = task.path if task.read is None else task.read
    if model.robot.unmeasured:  # has no verdict, as in the node
        return read_encoderless(bag, task.topics, model.robot), None
    efforts = task.read is None and task.health != "off"
    recording = read_inputs(
        bag, task.topics, model, motor_efforts=efforts, force_vectors=True, whole=False
    )
    if recording.is_table or not efforts:
        return recording, None
    return recording, _sensors(task, model, recording)


def _sensors(task: BagTask, model: Model, recording: Recording) -> Sensors:
    """Readings for a verdict on the robot: efforts of the motors, and load cells.

    Raises:
        BagError: the topic of the load cells cannot be read.
    """
    tensions: Mapping[str, Series] = {}
    topics = task.topics
    assert isinstance(topics, Topics), "of a bag"
    if task.load_cells in topics.references:
        tensions = recording.references
    elif task.load_cells in open_source(task.path).channels():
        topics = replace(topics, references=(task.load_cells,))
        tensions = read_recording(task.path, topics).references
    also = recording.references if task.health == "references" else {}
    efforts = {name: also.get(f"{EFFORT}/{name}") for name in model.layout.motors}
    cells = {
        name: tensions.get(f"{TENSION}/{name}", also.get(f"{TENSION}/{name}"))
        for name in model.layout.elements
    }
    efforts |= {n: one for n, one in recording.motor_efforts.items() if n in efforts}
    return Sensors(*({n: one for n, one in o.items() if one} for o in (efforts, cells)))
