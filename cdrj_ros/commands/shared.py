"""What the commands share: options, error lines, exit codes, progress, results."""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from time import monotonic
from typing import Final

from cdrj_ros import __version__
from cdrj_ros.bag import Topics
from cdrj_ros.estimation.comparison import BagComparison
from cdrj_ros.estimation.limits import Judgement
from cdrj_ros.model.errors import CdrjError, RobotFileError, UsageError
from cdrj_ros.model.plan import Model, prepare
from cdrj_ros.model.robot_file import build_robot, load_document

DONE: Final = 0
OUTSIDE_LIMITS: Final = 1
BAD_INPUT: Final = 2
INTERRUPTED: Final = 130

LINE_S: Final = 5.0
"""Time between two lines of progress where there is no terminal [s]."""


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
        print(f"{name}: interrupted", file=sys.stderr)
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


def load_model(path: str, preload: str | Sequence[float] | None = None) -> Model:
    """Read and prepare a robot file; a bare name means one of the installed ones.

    Args:
        path: the file, or a name.
        preload: of every cable [N], as numbers or as text with commas; None or empty for the
            file's.

    Raises:
        CdrjError: what is wrong with either, in one line.
    """
    document, source = load_document(robot_path(path))
    if not preload:
        return prepare(build_robot(document, source))
    try:
        values = [float(v) for v in (preload.split(",") if isinstance(preload, str) else preload)]
    except ValueError as error:
        raise UsageError(f"preload must be numbers and commas, got {preload!r}") from error
    cables = document["cables"]
    if len(values) != len(cables) or not all(0.0 <= value < 1e6 for value in values):
        raise UsageError(
            f"preload needs {len(cables)} tensions in [0, 1e6) N, one for each of "
            f"{', '.join(cable['name'] for cable in cables)}; got {preload!r}"
        )
    for cable, value in zip(cables, values, strict=True):
        cable["preload"] = value
    return prepare(build_robot(document, source))


def robot_path(path: str) -> Path:
    """The robot file; a bare name means one of the installed ones.

    Raises:
        RobotFileError: there is none of that name.
    """
    if not Path(path).exists() and "/" not in path and not path.endswith(".yaml"):
        for folder in _installed_robots():
            if (folder / f"{path}.yaml").exists():
                return folder / f"{path}.yaml"
        raise RobotFileError(f"there is no robot file {path}, and none of that name is installed")
    return Path(path)


def _installed_robots() -> Iterator[Path]:
    """Folders that may hold the package's own robot files: beside the source, or installed."""
    here = Path(__file__).resolve()
    yield here.parents[2] / "config" / "robots"
    for parent in here.parents:
        yield parent / "share" / "cdrj_ros" / "config" / "robots"


def _lines(description: str, total: float) -> Callable[[float], None]:
    """Progress where there is no terminal: a line now and then."""
    begin = last = monotonic()

    def report(done: float) -> None:
        nonlocal last
        if monotonic() - last > LINE_S:
            last = monotonic()
            share = done / max(total, 1e-9)
            left = (last - begin) * (1.0 / share - 1.0) if share >= 0.01 else 0.0
            remaining = f", {left:.0f} s left" if left >= 0.5 else ""
            text = f"{description}: {100.0 * share:.0f} %{remaining}"
            print(text, file=sys.stderr, flush=True)

    return report


@contextmanager
def progress_bar(description: str, total: float) -> Iterator[Callable[[float], None]]:
    """A bar on standard error; yields a function that takes what is done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(file=sys.stderr)
    if not console.is_terminal:
        yield _lines(description, total)
        return
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(), console=console, transient=True,
    ) as progress:  # fmt: skip
        task = progress.add_task(description, total=total)
        yield lambda done: progress.update(task, completed=done)


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
    from cdrj_ros.estimation.metrics import pooled_errors
    from cdrj_ros.report.table import print_judgement, print_table
    from cdrj_ros.validation import PUBLISHED, PUBLISHED_HEADING, robot_summary

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
        from cdrj_ros.estimation.inspection import inspect_robot
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
