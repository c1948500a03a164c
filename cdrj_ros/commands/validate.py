"""``validate``: bags through the estimator, offline and in lock-step, against their references."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from io import StringIO
from math import isfinite
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

from cdrj_ros.bag import Topics, size_of
from cdrj_ros.commands.shared import (
    DONE,
    OUTSIDE_LIMITS,
    add_result_options,
    add_robot_option,
    add_topic_options,
    run_command,
    topic_prefix,
    topics_of,
    write_results,
)
from cdrj_ros.foundation.errors import BagError, UsageError
from cdrj_ros.foundation.progress import progress_bar
from cdrj_ros.judgement.comparison import BagComparison
from cdrj_ros.judgement.limits import judge, load_limits
from cdrj_ros.judgement.validation import (
    OUTPUTS,
    compare_with_references,
    condition_recording,
    estimate,
    estimate_channels,
    friction_at_pulleys,
    read_inputs,
    stddev_channels,
    write_estimates,
)
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot

READING_SHARE = 0.5
"""Of the time that a bag takes, for the progress shown."""

MOST_JOBS = 64

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Task:
    """What to do with one bag."""

    path: str
    topics: Topics
    window: tuple[float, float] = (0.0, float("inf"))
    """Seconds after the bag's begin from and to which references are compared."""
    outputs: tuple[str, str, str] = OUTPUTS
    """Topics of the estimates in the bag that is written."""
    spread: bool = False
    """Standard deviations too."""
    written: str = ""
    """Bag to be made with the estimates beside the original messages; empty for none."""


def validate_bag(
    model: Model, path: str, topics: Topics, progress: Progress | None = None
) -> BagComparison:
    """One bag through the estimator, compared with its references.

    Raises:
        BagError: the bag cannot be read or has nothing to compare.
    """
    return _validate(model, Task(path, topics), progress)


def _validate(model: Model, task: Task, progress: Progress | None = None) -> BagComparison:
    begin = perf_counter()
    recording = read_inputs(task.path, task.topics, model)
    conditioned = condition_recording(model, recording)
    read = perf_counter()
    if progress:
        progress(READING_SHARE)

    def on(share: float) -> None:
        if progress:
            progress(READING_SHARE + (1.0 - READING_SHARE) * share)

    estimates = estimate(model, conditioned, on, spread=task.spread)
    done = perf_counter()
    facts = {
        "samples": f"{estimates.stamp_ns.size}",
        "time": f"{read - begin:.2f} s reading, {done - read:.2f} s estimating",
        "path": "offline, in lock-step",
    }
    comparison = compare_with_references(
        model,
        task.path,
        recording,
        conditioned,
        estimates.stamp_ns,
        estimate_channels(model.layout, estimates.values),
        facts,
        stddev=stddev_channels(model.layout, estimates.stddev),
        friction=friction_at_pulleys(estimates),
        window=task.window,
    )
    if task.written:
        write_estimates(task.written, task.path, recording, estimates, task.outputs)
    return comparison


_model: list[Model] = []
"""The robot of a worker process."""


def _start_worker(robot: str, preload: str | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent says when to stop
    _model.append(load_model(robot, preload))


def _work(task: Task) -> BagComparison:
    return _validate(_model[0], task)


def _one_by_one(model: Model, tasks: Sequence[Task], report: Progress) -> Iterator[BagComparison]:
    sizes = [size_of(task.path) for task in tasks]
    done = 0.0
    for task, size in zip(tasks, sizes, strict=True):

        def within_bag(share: float, before: float = done, size: int = size) -> None:
            report(before + share * size)

        yield _validate(model, task, within_bag)
        done += size
        report(done)


def _in_processes(
    arguments: argparse.Namespace, tasks: Sequence[Task], jobs: int, report: Progress
) -> Iterator[BagComparison]:
    """Results in the order of the tasks; progress in the order in which they are done."""
    from threading import Lock

    lock, done = Lock(), 0.0
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__])  # one import for all workers
    pool = ProcessPoolExecutor(
        jobs,
        mp_context=context,
        initializer=_start_worker,
        initargs=(arguments.robot, arguments.preload),
    )

    def count(task: Task, _: object) -> None:
        nonlocal done
        with lock:
            done += size_of(task.path)
            report(done)

    try:
        futures = [pool.submit(_work, task) for task in tasks]
        for task, future in zip(tasks, futures, strict=True):
            future.add_done_callback(partial(count, task))
        for future in futures:
            yield future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="validate",
        description=__doc__.split(": ", 1)[1],
        epilog="Exit code: 0 done, 1 outside the limits, 2 bad usage or input.",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    add_robot_option(parser)
    add_topic_options(parser)
    parser.add_argument(
        "--start", type=float, default=0.0, metavar="S",
        help="compare from this many seconds after the bag's begin on; the estimator sees what is "
        "before, since friction remembers (default %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--duration", type=float, metavar="S", help="compare for so many seconds (default: all)"
    )
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N",
        help="bags at a time, each in a process of its own; 0: as many as there are processors "
        "(default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--limits", metavar="FILE",
        help="bounds on the figures (YAML, docs/validate.md); exit code 1 where one is outside",
    )  # fmt: skip
    parser.add_argument(
        "--write-bag", metavar="OUT",
        help="write an MCAP bag of everything in the original with the estimates beside it; of "
        "several bags, one each in the folder OUT",
    )  # fmt: skip
    parser.add_argument(
        "--uncertainty", choices=("auto", "on", "off"), default="auto",
        help="standard deviations of the estimates and how often the reference lies within two of "
        "them; auto: where the robot file says how well it is known (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="print only what is wrong")
    add_result_options(parser)
    return parser


def _tasks(arguments: argparse.Namespace, robot: Robot) -> list[Task]:
    """One for each bag; refuses what could not be written before anything is read."""
    start, duration = arguments.start, arguments.duration
    if not (isfinite(start) and start >= 0.0):
        raise UsageError(f"--start must be at least 0 s, got {start}")
    if duration is not None and not 0.0 < duration < float("inf"):
        raise UsageError(f"--duration must be more than 0 s, got {duration}")
    window = (start, float("inf") if duration is None else start + duration)
    topics = topics_of(arguments)
    spread = arguments.uncertainty == "on"
    if arguments.uncertainty == "auto":
        spread = robot.uncertainty is not None
    prefix = topic_prefix(arguments)
    outputs = (prefix + OUTPUTS[0], prefix + OUTPUTS[1], prefix + OUTPUTS[2])
    out = arguments.write_bag
    written = [""] * len(arguments.bags)
    if out:
        names = [Path(path).resolve().name.partition(".mcap")[0] for path in arguments.bags]
        if len(set(names)) < len(names):
            raise UsageError("--write-bag needs bags of different names, to name those it writes")
        written = [out] if len(names) == 1 else [str(Path(out) / name) for name in names]
        for path in written:
            if Path(path).exists():
                raise BagError(f"{path} exists already; a bag is written to a new folder")
    return [
        Task(path, topics, window, outputs, spread, new)
        for path, new in zip(arguments.bags, written, strict=True)
    ]


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    if not 0 <= arguments.jobs <= MOST_JOBS:
        raise UsageError(f"--jobs must be from 0 to {MOST_JOBS}, got {arguments.jobs}")
    for path in (arguments.json, arguments.html):
        if path and not Path(path).absolute().parent.is_dir():
            raise UsageError(f"{path} cannot be written: there is no folder {Path(path).parent}")
    limits = load_limits(arguments.limits) if arguments.limits else None
    model = load_model(arguments.robot, arguments.preload)
    tasks = _tasks(arguments, model.robot)
    jobs = min(arguments.jobs or os.cpu_count() or 1, len(tasks))
    total = sum(size_of(task.path) for task in tasks)
    with progress_bar("validating", total) as report:
        if jobs > 1:
            comparisons = list(_in_processes(arguments, tasks, jobs, report))
        else:
            comparisons = list(_one_by_one(model, tasks, report))
    judgement = judge(limits, comparisons) if limits else None
    title = f"{model.robot.name}: estimate against reference"
    silent = contextlib.redirect_stdout(StringIO()) if arguments.quiet else contextlib.nullcontext()
    with silent:
        write_results(arguments, model, comparisons, title, judgement)
        for task in tasks:
            if task.written:
                print(f"bag: {task.written} (estimates on {', '.join(task.outputs)})")
    if judgement and judgement.outside:
        if arguments.quiet:
            from cdrj_ros.report.table import print_judgement

            print_judgement(judgement)
        return OUTSIDE_LIMITS
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("validate", _body, argv)
