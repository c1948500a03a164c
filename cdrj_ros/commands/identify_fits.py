"""The fits of ``identify``, and their comparison with bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cdrj_ros.commands.identify_results import Compared, fold_line
from cdrj_ros.commands.identify_task import Task
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.metrics import pooled_errors
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.foundation.progress import progress_text
from cdrj_ros.identification.fit import Identification, identify
from cdrj_ros.identification.observations import Recorded
from cdrj_ros.identification.problem import Pool, Settings
from cdrj_ros.identification.unknowns import Unknown
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings import Topics
from cdrj_ros.robot.document import Document
from cdrj_ros.robot.parameters import with_numbers
from cdrj_ros.robot.reader import build_robot


def fit(
    document: Document,
    source: str,
    unknowns: Sequence[Unknown],
    recordings: Sequence[Recorded],
    settings: Settings,
    pool: Pool | None,
) -> Identification:
    """``identify``, with a line for each round on standard error."""
    with progress_text(lambda text: "samples" in text) as progress:
        return identify(document, source, unknowns, recordings, settings, progress, pool)


def cross_validated(
    task: Task, found: Identification, recordings: Sequence[Recorded], pool: Pool | None
) -> tuple[list[BagComparison], tuple[str, ...]]:
    """Compare every bag with the estimates of a fit without this bag.

    Returns:
        The comparisons, and a line for each fit.
    """
    unseen: list[BagComparison] = []
    lines = []
    settings = task.settings
    rough = Settings(
        found.channels, settings.weights, settings.sigmas, settings.loss, 1, 0,
        settings.settle_s, coarse=True,
    )  # fmt: skip
    begin = with_numbers(task.document, found.by_path)
    again = [replace(u, start=float(v)) for u, v in zip(found.unknowns, found.values, strict=True)]
    for pattern, out in task.folds.items():
        others = [one for k, one in enumerate(recordings) if k not in out]
        fold = fit(begin, task.source, again, others, rough, pool)
        robot = build_robot(with_numbers(task.document, fold.by_path), task.source)
        judged = validated([task.bags[k] for k in out], task.topics, prepare(robot))
        unseen += judged
        lines.append(fold_line(pattern, judged, found.channels))
    return unseen, tuple(lines)


def validated(bags: Sequence[str], topics: Topics, model: Model) -> list[BagComparison]:
    """The comparisons that ``validate`` makes."""
    return [validate_bag(model, bag, topics) for bag in bags]


def compared(bags: Sequence[str], topics: Topics, fitted: Model, before: Model) -> Compared:
    """Errors on some bags with the identified numbers and with the starting values."""
    return Compared(
        pooled_errors(validated(bags, topics, fitted)),
        pooled_errors(validated(bags, topics, before)),
    )
