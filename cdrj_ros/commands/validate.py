"""``validate``: bags through the estimator, offline and in lock-step, against their references."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from time import perf_counter

from cdrj_ros.bag import Topics
from cdrj_ros.commands.shared import (
    DONE,
    add_result_options,
    add_robot_option,
    add_topic_options,
    load_model,
    progress_bar,
    run_command,
    topics_of,
    write_results,
)
from cdrj_ros.estimation.comparison import BagComparison
from cdrj_ros.model.plan import Model
from cdrj_ros.validation import (
    compare_with_references,
    condition_recording,
    estimate,
    estimate_channels,
    read_inputs,
)


def validate_bag(model: Model, path: str, topics: Topics) -> BagComparison:
    """One bag through the estimator, compared with its references.

    Raises:
        BagError: the bag cannot be read or has nothing to compare.
    """
    begin = perf_counter()
    recording = read_inputs(path, topics, model)
    conditioned = condition_recording(model, recording)
    read = perf_counter()
    estimates = estimate(model, conditioned)
    done = perf_counter()
    samples = estimates.stamp_ns.size
    facts = {
        "samples": f"{samples}",
        "time": f"{read - begin:.2f} s reading, {done - read:.2f} s estimating",
        "path": "offline, in lock-step",
    }
    channels = estimate_channels(model.layout, estimates.values)
    return compare_with_references(
        model, path, recording, conditioned, estimates.stamp_ns, channels, facts
    )


def _body(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="validate", description=__doc__.split(": ", 1)[1])
    parser.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 folder or .mcap file")
    add_robot_option(parser)
    add_topic_options(parser)
    add_result_options(parser)
    arguments = parser.parse_args(argv)
    model = load_model(arguments.robot, arguments.preload)
    topics = topics_of(arguments)
    comparisons = []
    with progress_bar("validating", len(arguments.bags)) as report:
        for path in arguments.bags:
            comparisons.append(validate_bag(model, path, topics))
            report(len(comparisons))
    write_results(arguments, model, comparisons, f"{model.robot.name}: estimate against reference")
    return DONE


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("validate", _body, argv)
