"""``validate``: run the estimator on bags, offline, and compare it with their references."""

from __future__ import annotations

import argparse
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from math import isfinite
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

import numpy as np

from cdrj_ros.bag import Topics, size_of
from cdrj_ros.commands.compilation import announce_compilation
from cdrj_ros.commands.running import DONE, OUTSIDE_LIMITS, CommandParser, run_command
from cdrj_ros.commands.shared import (
    add_result_options,
    add_robot_option,
    add_topic_options,
    print_results,
    topic_prefix,
    topics_of,
    write_files,
)
from cdrj_ros.foundation.errors import BagError, UsageError
from cdrj_ros.foundation.files import check_outputs
from cdrj_ros.foundation.output import say
from cdrj_ros.foundation.progress import progress_bar
from cdrj_ros.judgement.channels import BagComparison
from cdrj_ros.judgement.estimates_bag import OUTPUTS, write_estimates
from cdrj_ros.judgement.limits import judge, load_limits
from cdrj_ros.judgement.metrics import errors_of
from cdrj_ros.judgement.validation import (
    WHOLE,
    Validation,
    Window,
    condition_recording,
    read_inputs,
    require_reference_topics,
)
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot

READING_SHARE = 0.3
"""Share of the processing time of a bag that reading takes, for the progress display."""

MOST_JOBS = 64

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Task:
    """The work on one bag."""

    path: str
    topics: Topics
    robot: str = ""
    """The robot file."""
    preload: str | None = None
    """Preloads that replace those of the robot file."""
    window: Window = WHOLE
    outputs: tuple[str, str, str] = OUTPUTS
    """Topics of the estimates in the bag that is written."""
    spread: bool = False
    """Whether standard deviations are computed."""
    written: str = ""
    """Bag to write with the original messages and the estimates; empty for none."""


_prepared = cache(load_model)


def validate_bag(
    model: Model,
    path: str,
    topics: Topics,
    progress: Progress | None = None,
    *,
    spread: bool = False,
) -> BagComparison:
    """Run the estimator on one bag and compare it with the bag's references.

    Raises:
        BagError: the bag cannot be read or has nothing to compare.
    """
    return _validate(model, Task(path, topics, spread=spread), progress)


def _validate(model: Model, task: Task, progress: Progress | None = None) -> BagComparison:
    begin = perf_counter()
    recording = read_inputs(task.path, task.topics, model)
    conditioned = condition_recording(model, recording)
    if len(conditioned.segments) == 1 and not task.written:
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
    )
    if task.written:
        stamps = np.concatenate([segment.stamp_ns for segment in conditioned.segments])
        write_estimates(
            task.written, task.path, recording, stamps, validation.pieces(), task.outputs
        )
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


def _start_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process decides when to stop


def _work(task: Task) -> BagComparison:
    return _validate(_prepared(task.robot, task.preload), task)


def _one_by_one(tasks: Sequence[Task], report: Progress) -> Iterator[BagComparison]:
    sizes = [size_of(task.path) for task in tasks]
    done = 0.0
    for task, size in zip(tasks, sizes, strict=True):

        def within_bag(share: float, before: float = done, size: int = size) -> None:
            report(before + share * size)

        yield _validate(_prepared(task.robot, task.preload), task, within_bag)
        done += size
        report(done)


def _in_processes(tasks: Sequence[Task], jobs: int, report: Progress) -> Iterator[BagComparison]:
    """Results in the order of the tasks; progress in the order in which they are done."""
    from threading import Lock

    lock, done = Lock(), 0.0
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__])  # one import for all workers
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_start_worker)

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
    parser = CommandParser(
        prog="validate",
        description="Run bags through the estimator offline, in lock-step, and compare the "
        "estimates with the recorded references.",
        epilog="Exit code: 0 done, 1 outside the limits, 2 bad usage or input.",
    )
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    add_robot_option(parser, several=True)
    add_topic_options(parser)
    parser.add_argument(
        "--start", type=float, default=0.0, metavar="S",
        help="compare from S seconds after the start of the bag; the estimator still processes "
        "what precedes, as friction depends on it (default %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--duration", type=float, metavar="S", help="compare for S seconds (default: all)"
    )
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N",
        help="number of bags processed at a time, each in its own process; 0: one per processor "
        "(default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--limits", metavar="FILE",
        help="limits of the figures (YAML, docs/validate.md); exit code 1 if a figure is outside",
    )  # fmt: skip
    parser.add_argument(
        "--write-bag", metavar="OUT",
        help="write an MCAP bag with everything in the original and the estimates; for several "
        "bags, one each in the folder OUT",
    )  # fmt: skip
    parser.add_argument(
        "--uncertainty", choices=("auto", "on", "off"), default="auto",
        help="compute standard deviations of the estimates and their coverage; auto: if the robot "
        "file has numbers that are not exact, or a bag is written (default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--quiet", action="store_true", help="print errors and violated limits only"
    )
    add_result_options(parser)
    return parser


def _tasks(arguments: argparse.Namespace, robot: Robot) -> list[Task]:
    """One for each bag; refuses outputs that cannot be written before any bag is read."""
    bags, topics = arguments.bags, topics_of(arguments)
    window = _window(arguments.start, arguments.duration)
    spread = arguments.uncertainty == "on"
    if arguments.uncertainty == "auto":  # a bag has the status that the node would publish
        spread = robot.uncertainty is not None or bool(arguments.write_bag)
    prefix = topic_prefix(arguments)
    outputs = (prefix + OUTPUTS[0], prefix + OUTPUTS[1], prefix + OUTPUTS[2])
    return [
        Task(path, topics, arguments.robot, preload, window, outputs, spread, written)
        for path, preload, written in zip(
            bags, _preloads(arguments), _written(arguments.write_bag, bags), strict=True
        )
    ]


def _window(start: float, duration: float | None) -> Window:
    if not (isfinite(start) and start >= 0.0):
        raise UsageError(f"--start must be at least 0 s, got {start}")
    if duration is None:
        return (start, float("inf"))
    if not 0.0 < duration < float("inf"):
        raise UsageError(f"--duration must be more than 0 s, got {duration}")
    return (start, start + duration)


def _preloads(arguments: argparse.Namespace) -> list[str | None]:
    """The preloads of every bag: one for all of them, or one each."""
    given: list[str | None] = arguments.preload or [None]
    if len(given) not in (1, len(arguments.bags)):
        raise UsageError(
            f"--preload must be given once, or once for each of the {len(arguments.bags)} bags; "
            f"got {len(given)}"
        )
    return given if len(given) > 1 else given * len(arguments.bags)


def _written(out: str | None, bags: Sequence[str]) -> list[str]:
    """The bag to write for every bag that is read; empty for none."""
    if not out:
        return [""] * len(bags)
    names = [Path(path).resolve().name.partition(".mcap")[0] for path in bags]
    if len(set(names)) < len(names):
        raise UsageError(
            "--write-bag needs bags with different names, because it names the new bags after them"
        )
    written = [out] if len(names) == 1 else [str(Path(out) / name) for name in names]
    for path in written:
        if Path(path).exists():
            raise BagError(f"{path} exists already; a bag is written to a new folder")
    return written


def _check_files(arguments: argparse.Namespace) -> None:
    """Refuse outputs that cannot be written or name an input, before any work."""
    inputs = [*arguments.bags, arguments.robot, *([arguments.limits] if arguments.limits else [])]
    outputs = {"--json": arguments.json, "--html": arguments.html}
    new = Path(arguments.write_bag or "")
    if arguments.write_bag and not new.exists() and new.absolute().parent.is_dir():
        outputs["--write-bag"] = arguments.write_bag
    check_outputs(outputs, inputs)


def _body(argv: Sequence[str]) -> int:
    arguments = _parser().parse_args(argv)
    if not 0 <= arguments.jobs <= MOST_JOBS:
        raise UsageError(f"--jobs must be from 0 to {MOST_JOBS}, got {arguments.jobs}")
    _check_files(arguments)
    limits = load_limits(arguments.limits) if arguments.limits else None
    preloads = _preloads(arguments)
    announce_compilation()
    model = _prepared(arguments.robot, preloads[0])
    tasks = _tasks(arguments, model.robot)
    for task in tasks:
        _prepared(task.robot, task.preload)
        require_reference_topics(task.path, task.topics)
    jobs = min(arguments.jobs or os.cpu_count() or 1, len(tasks))
    with progress_bar("validating", sum(size_of(task.path) for task in tasks)) as report:
        bags = list(_in_processes(tasks, jobs, report) if jobs > 1 else _one_by_one(tasks, report))
    errors = errors_of(bags)
    judgement = judge(limits, errors) if limits else None
    title = f"{model.robot.name}: estimate against reference"
    stated = len(set(preloads)) == 1
    write_files(arguments, model, errors, title, judgement, preload_stated=stated)
    if not arguments.quiet:
        print_results(arguments, model, errors, title, judgement)
        for task in tasks:
            if task.written:
                say(f"bag: {task.written} (estimates on {', '.join(task.outputs)})")
    outside = judgement is not None and bool(judgement.outside)
    if judgement is not None and outside and arguments.quiet:
        from cdrj_ros.report.table import print_judgement

        print_judgement(judgement)
    return OUTSIDE_LIMITS if outside else DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("validate", _body, argv)


if __name__ == "__main__":
    raise SystemExit(main())
