"""What the commands share: options, error lines, exit codes, progress, results."""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Callable, Sequence
from importlib import metadata
from typing import Final

from cdrj_ros import __version__
from cdrj_ros.bag import Topics
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.interruption import INTERRUPTED, announce_interruption
from cdrj_ros.judgement.comparison import BagComparison
from cdrj_ros.judgement.limits import Judgement
from cdrj_ros.model.prepared import Model

DONE: Final = 0
OUTSIDE_LIMITS: Final = 1
BAD_INPUT: Final = 2


def run_command(name: str, body: Callable[[Sequence[str]], int], argv: Sequence[str] | None) -> int:
    """Run a command's body; errors of this package become one line and exit code 2."""
    try:
        return body(sys.argv[1:] if argv is None else argv)
    except CdrjError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        return DONE
    except OSError as error:
        print(f"{name}: {error.filename or ''}: {error.strerror}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        announce_interruption(name)
        return INTERRUPTED


def add_robot_option(parser: argparse.ArgumentParser) -> None:
    """``--robot FILE``, ``--preload N,N,...``."""
    parser.add_argument("--robot", required=True, metavar="FILE", help="robot file (YAML)")
    parser.add_argument(
        "--preload", metavar="N,N,...",
        help="preload of every cable [N], in the robot file's order (default: the file's)",
    )  # fmt: skip


def add_topic_options(parser: argparse.ArgumentParser) -> None:
    """``--motor-topic``, ``--joint-topic``, ``--reference``, ``--topic-prefix``."""
    defaults = Topics()
    parser.add_argument(
        "--motor-topic", metavar="TOPIC",
        help=f"JointState with the motor angles (default {defaults.motors})",
    )  # fmt: skip
    parser.add_argument(
        "--joint-topic", metavar="TOPIC",
        help=f"JointState with the joint angles (default {defaults.joints})",
    )  # fmt: skip
    parser.add_argument(
        "--reference", action="append", metavar="TOPIC",
        help="recorded truth: CableTensions, NodalForces, or JointState with efforts; "
        f"repeatable (default {', '.join(defaults.references)})",
    )  # fmt: skip
    parser.add_argument(
        "--topic-prefix", default="", metavar="NAMESPACE",
        help="put before every default topic: /left for /left/cdrj/motor_states, ...",
    )  # fmt: skip


def add_result_options(parser: argparse.ArgumentParser) -> None:
    """``--json``, ``--html``."""
    parser.add_argument("--json", metavar="FILE", help="write the figures as JSON")
    parser.add_argument("--html", metavar="FILE", help="write a report with pictures")


def topic_prefix(arguments: argparse.Namespace) -> str:
    """What ``--topic-prefix`` puts before topics: empty, or with a leading slash only."""
    prefix = str(arguments.topic_prefix).strip("/")
    return f"/{prefix}" if prefix else ""


def topics_of(arguments: argparse.Namespace) -> Topics:
    """The topics that the options name."""
    defaults = Topics()
    prefix = topic_prefix(arguments)
    references = arguments.reference
    return Topics(
        arguments.motor_topic or prefix + defaults.motors,
        arguments.joint_topic or prefix + defaults.joints,
        tuple(references or (prefix + topic for topic in defaults.references)),
    )


def versions() -> dict[str, str]:
    """What produced the numbers."""
    named = {"cdrj_ros": __version__, "Python": platform.python_version()}
    for package in ("numpy", "scipy", "numba", "rosbags", "mcap"):
        named[package] = metadata.version(package)
    return named


def write_results(
    arguments: argparse.Namespace,
    model: Model,
    comparisons: Sequence[BagComparison],
    title: str,
    judgement: Judgement | None = None,
) -> None:
    """Print the table, then write what the options ask for."""
    from cdrj_ros.judgement.metrics import pooled_errors
    from cdrj_ros.judgement.validation import PUBLISHED, PUBLISHED_HEADING, robot_summary
    from cdrj_ros.report.table import print_judgement, print_table

    beside = PUBLISHED if model.robot.name == "prototype" else None
    heading = PUBLISHED_HEADING if beside else ""
    for comparison in comparisons:
        for note in comparison.notes:
            print(f"note: {comparison.path}: {note}")
        for cause, count in comparison.counters.items():
            if count:
                print(f"left out: {comparison.path}: {count} {cause}")
    print_table(pooled_errors(comparisons), title=title, beside=beside, beside_heading=heading)
    if judgement:
        print_judgement(judgement)
    if arguments.json:
        from cdrj_ros.report.results_json import write_results as write_json

        write_json(arguments.json, comparisons, judgement)
        print(f"figures: {arguments.json}")
    if arguments.html:
        from cdrj_ros.inspection.ranges import inspect_robot
        from cdrj_ros.report.drawing import draw_robot
        from cdrj_ros.report.html import write_report

        write_report(
            arguments.html,
            comparisons,
            title=title,
            robot_summary=robot_summary(model),
            versions=versions(),
            beside=beside,
            beside_heading=heading,
            judgement=judgement,
            robot=model.robot,
            drawing=draw_robot(inspect_robot(model)),
        )
        print(f"report: {arguments.html}")
