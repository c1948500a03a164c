"""The work on one bag: read, condition, estimate, compare."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Final, Literal, get_args

from cdrj_ros.bag import Recording, Series, Topics, open_source, read_recording
from cdrj_ros.judgement.channels import BagComparison
from cdrj_ros.judgement.estimates_bag import OUTPUTS, log_times, write_estimates
from cdrj_ros.judgement.inputs import condition_recording, read_inputs, require_axes
from cdrj_ros.judgement.motor_alone import condition_alone, read_alone
from cdrj_ros.judgement.references import WHOLE, Window
from cdrj_ros.judgement.validation import Sensors, Validation
from cdrj_ros.messages.topics import TENSION_SENSORS, in_namespace
from cdrj_ros.model.channels import EFFORT, TENSION
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model

LOAD_CELLS: Final = in_namespace(TENSION_SENSORS)
"""Topic of the load cells in the default namespace."""

READING_SHARE: Final = 0.3
"""Share of the processing time of a bag that reading takes, for the progress display."""

Progress = Callable[[float], None]

Health = Literal["auto", "references", "off"]
HEALTH: Final[tuple[Health, ...]] = get_args(Health)
"""What the health monitor may hear: what the node would hear, references too, or nothing."""


@dataclass(frozen=True)
class BagTask:
    """The work on one bag, with everything that another process needs for it."""

    path: str
    """The bag, as the user named it."""
    topics: Topics
    robot: str = ""
    """The robot file."""
    preload: str | None = None
    """Preloads that replace those of the robot file."""
    window: Window = WHOLE
    outputs: tuple[str, str, str] = OUTPUTS
    """Topics of the estimates in the written bag."""
    spread: bool = False
    """Whether standard deviations are computed."""
    written: str = ""
    """Bag to write with the original messages and the estimates; empty for none."""
    health: Health = "off"
    """What the health monitor hears: what the node would hear, or also the references."""
    load_cells: str = LOAD_CELLS
    """Topic of the load cells that the node would hear."""
    folder: str = ""
    """Folder from which relative paths start, for a process with another working folder."""


prepared_model = cache(load_model)
"""The model of a robot file with preloads, loaded once per process."""


def compare_bag(task: BagTask, progress: Progress | None = None) -> BagComparison:
    """Run the estimator on one bag and compare it with the bag's references.

    Args:
        task: the work.
        progress: called with the completed fraction, from 0 to 1.

    Raises:
        BagError: the bag cannot be read or has nothing to compare.
        RobotFileError: the robot file describes no possible robot.
    """
    model = prepared_model(str(Path(task.folder, task.robot)), task.preload)
    return compare_bag_with(model, task, progress)


def validate_bag(
    model: Model,
    path: str,
    topics: Topics,
    progress: Progress | None = None,
    *,
    spread: bool = False,
) -> BagComparison:
    """``compare_bag`` with a given model; ``spread`` requests standard deviations."""
    return compare_bag_with(model, BagTask(path, topics, spread=spread), progress)


def compare_bag_with(
    model: Model, task: BagTask, progress: Progress | None = None
) -> BagComparison:
    """``compare_bag`` with a given model."""
    begin = perf_counter()
    sensors = None  # a robot with joints without encoder has no health monitor, as in the node
    path = str(Path(task.folder, task.path)) if task.folder else task.path
    if model.robot.unmeasured:
        recording = read_alone(path, task.topics, model.robot)
        require_axes(path, recording, model.robot.as_read)
        conditioned = condition_alone(model, recording)
    else:
        efforts = task.health != "off"
        recording = read_inputs(path, task.topics, model, motor_efforts=efforts, force_vectors=True)
        conditioned = condition_recording(model, recording)
        if task.health != "off":
            sensors = _sensors(path, task, model, recording)
    log_ns = log_times(recording, conditioned) if task.written else None
    if len(conditioned.segments) == 1:
        recording = replace(recording, motors={}, joints={})  # one hour of readings is 130 MB
    reading_s = perf_counter() - begin
    if progress:
        progress(READING_SHARE)

    def on(share: float) -> None:
        if progress:
            progress(READING_SHARE + (1.0 - READING_SHARE) * share)

    begin = perf_counter()
    validation = Validation(
        model,
        task.path,
        recording,
        conditioned,
        spread=task.spread,
        window=task.window,
        progress=on,
        sensors=sensors,
    )
    if log_ns is not None:
        written = str(Path(task.folder, task.written))
        write_estimates(written, path, log_ns, validation.pieces(), task.outputs)
    else:
        for _ in validation.pieces():
            pass
    comparison = validation.result()
    facts = {
        "samples": f"{sum(segment.stamp_ns.size for segment in conditioned.segments)}",
        "time": f"{reading_s:.2f} s reading, {perf_counter() - begin:.2f} s estimating",
        "path": "offline, in lock-step",
    }
    if task.preload is not None:
        facts["preload"] = f"{task.preload} N"
    return replace(comparison, facts=facts)


def _sensors(path: str, task: BagTask, model: Model, recording: Recording) -> Sensors:
    """Readings for the health monitor: efforts of the motors, and load cells.

    Raises:
        BagError: the topic of the load cells cannot be read.
    """
    tensions: Mapping[str, Series] = {}
    if task.load_cells in task.topics.references:
        tensions = recording.references
    elif task.load_cells in open_source(path).channels():
        topics = replace(task.topics, references=(task.load_cells,))
        tensions = read_recording(path, topics).references
    also = recording.references if task.health == "references" else {}
    efforts = {name: also.get(f"{EFFORT}/{name}") for name in model.layout.motors}
    cells = {
        name: tensions.get(f"{TENSION}/{name}", also.get(f"{TENSION}/{name}"))
        for name in model.layout.elements
    }
    efforts |= {n: one for n, one in recording.motor_efforts.items() if n in efforts}
    return Sensors(*({n: one for n, one in o.items() if one} for o in (efforts, cells)))
