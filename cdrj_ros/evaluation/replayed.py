"""Compares a replay's answers with the references, and the estimator's settings with its own."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.conditioner import MODES, Mode
from cdrj_ros.evaluation.answers import Answers
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.inputs import counters_of, nothing_beside
from cdrj_ros.evaluation.validation import Validation
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.recording import Recording

TOLERANCE: Final = 1e-6
"""Relative difference up to which two preloads count as equal."""


class NodeSettings(NamedTuple):
    """Parameters of an estimator node that matter for a replay."""

    conditioning: Mode = MODES[0]
    preload: tuple[float, ...] = ()
    """Current preload of every cable [N]; empty if unknown."""
    max_rate_hz: float = 0.0
    """Maximum rate of published estimates [Hz]; 0: no limit."""


def require_every_sample(settings: NodeSettings) -> None:
    """Check that the node publishes every estimate.

    Raises:
        UsageError: it does not, and the replay would count the missing estimates as lost.
    """
    if settings.max_rate_hz > 0.0:
        raise UsageError(
            "the estimator publishes only some of its estimates (max_rate = "
            f"{settings.max_rate_hz:g} Hz); for a replay start it with max_rate:=0"
        )


def preload_difference(model: Model, settings: NodeSettings) -> str:
    """Describe preloads of the node that differ from the replay's robot, with remedies.

    Args:
        model: the robot from the replay's ``--robot`` and ``--preload``.
        settings: settings of the node.

    Returns:
        One line with both values; empty if they agree or the node's preloads are unknown.
    """
    cables = model.robot.cables
    ours = [cable.preload for cable in cables]
    theirs = settings.preload
    if not theirs or (len(ours) == len(theirs) and np.allclose(ours, theirs, rtol=TOLERANCE)):
        return ""
    names = [cable.name for cable in cables]
    if len(ours) != len(theirs):
        return (
            f"the estimator has {len(theirs)} preloads, {model.robot.name} has {len(ours)}: "
            "it is of another robot"
        )
    text = ", ".join(
        f"{name} {node:g} N in the estimator, {own:g} N here"
        for name, node, own in zip(names, theirs, ours, strict=True)
    )
    return (
        f"preloads differ: {text}. The estimates are those of the estimator; start it with "
        f"-p preload:=[{','.join(f'{own:g}' for own in ours)}] or call its ~/set_preload"
    )


class Ending(enum.Enum):
    """Reason for the end of a playback."""

    END = "at the end"
    USER = "by the user"
    GONE = "because the estimator disappeared"


@dataclass(frozen=True, eq=False)
class Played:
    """What was played of a recording since a reset of the estimator, and its answers."""

    answers: Answers
    ending: Ending
    span_s: float
    """Duration of the played part of the recording [s]."""
    wall_s: float
    """Elapsed wall time [s]."""
    behind_s: float
    """Maximum delay of a message after its due time [s]; 0 if played as fast as possible."""

    def facts(self, duration_s: float) -> dict[str, str]:
        """Rows for the report."""
        tally, wall_s = self.answers.tally, max(self.wall_s, 1e-9)
        at = "" if self.ending is Ending.END else f" at {self.span_s:.3f} s"
        rows = {
            "path": "estimator node in another process, over DDS",
            "played": f"{self.span_s:.3f} s of {duration_s:.3f} s; ended {self.ending.value}{at}",
            "inputs sent": f"{tally.sent}",
            "estimates expected": f"{tally.expected}",
            "estimates received": f"{tally.received}",
            "estimates lost": f"{tally.lost}",
            "rate achieved": f"{self.span_s / wall_s:.2f} x real time, "
            f"{tally.sent / wall_s:.0f} inputs/s",
        }
        if self.behind_s > 0:
            rows["latest sending"] = f"{self.behind_s * 1e3:.2f} ms behind the recorded time"
        if self.answers.latency_s.size:
            p50, p99 = np.percentile(self.answers.latency_s, (50, 99)) * 1e3
            rows["latency"] = f"p50 {p50:.2f} ms, p99 {p99:.2f} ms from input sent to answer heard"
        if tally.strange:
            rows["answers not asked for"] = f"{tally.strange}"
        return rows

    def notes(self) -> tuple[str, ...]:
        """Remarks for the report; none if nothing went wrong."""
        tally = self.answers.tally
        found = []
        if tally.lost:
            found.append(f"{tally.lost} expected estimates did not arrive on all three topics.")
        if tally.strange:
            found.append(
                f"{tally.strange} answers belong to no input: another estimator or replay may be "
                "in the same ROS domain."
            )
        if jumps := self.answers.conditioned.clock_jumps:
            found.append(
                f"The clock of the recording went back {jumps} times; where stamps repeat, the "
                "later estimate counts."
            )
        return tuple(found)

    def comparison(self, model: Model, path: str, recording: Recording) -> BagComparison:
        """Compare with the references in the bag; the result has no channels if there are none."""
        duration_s = (recording.end_ns - recording.start_ns) * 1e-9
        facts, answers = self.facts(duration_s), self.answers
        if not recording.references or not answers.estimates.stamp_ns.size:
            counters = counters_of(recording, answers.conditioned)
            notes = (*recording.notes, *self.notes())
            return BagComparison(path, duration_s, (), counters, notes, facts)
        validation = Validation(model, path, recording, answers.conditioned)
        for _ in validation.compare([answers.estimates]):
            pass
        return validation.result(facts, self.notes())

    def why_nothing(self, model: Model, comparison: BagComparison, recording: Recording) -> str:
        """Why nothing was compared, in words; empty if something was."""
        if comparison.compared:
            return ""
        if not recording.references:
            return "the bag has no references; name their topics with --reference"
        stamps = self.answers.estimates.stamp_ns
        if not stamps.size:
            known = self.answers.conditioned.shortage(model.robot)
            return f"no estimate was received{': ' if known else ''}{known}"
        return nothing_beside(stamps, recording.references)
