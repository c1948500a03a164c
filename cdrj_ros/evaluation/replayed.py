"""Compares a replay's answers with the references, and the estimator's settings with its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.estimation.conditioner import MODES, Mode
from cdrj_ros.evaluation.answers import Answers, Tally
from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.inputs import counters_of, nothing_beside
from cdrj_ros.evaluation.validation import Validation
from cdrj_ros.foundation.arrays import Floats
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.recording import Recording

KEPT: Final = 1_000_000
"""Maximum number of stored latencies; it bounds the memory of an endless loop."""

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


@dataclass(eq=False)
class Outcome:
    """All passes over one recording; the answers of the last whole one are compared."""

    model: Model
    tally: Tally = field(default_factory=Tally)
    passes: int = 0
    """Number of passes, each of which begins with a reset of the estimator."""
    whole_passes: int = 0
    """Number of passes that were played to the end."""
    span_s: float = 0.0
    """Duration of the played parts of the recording, including repetitions [s]."""
    wall_s: float = 0.0
    """Elapsed wall time [s]."""
    behind_s: float = 0.0
    """Maximum delay of a message after its due time [s]."""
    ending: str = ""
    """Description of how the last pass ended."""
    difference: float = 0.0
    """Maximum difference between whole passes, over all channels [unit of the channel]."""
    answers: Answers | None = None
    """Of the last whole pass, or of the last one if none was whole."""
    latency_s: Floats = field(default_factory=lambda: np.empty(0))

    def add(self, answers: Answers, *, whole: bool) -> None:
        """Add one pass; ``whole`` if it was played to the end."""
        self.passes += 1
        self.tally += answers.tally
        self.latency_s = np.concatenate((self.latency_s, answers.latency_s))[-KEPT:]
        if whole and self.whole_passes and self.answers:
            before, after = self.answers.estimates, answers.estimates
            _, mine, new = np.intersect1d(before.stamp_ns, after.stamp_ns, return_indices=True)
            gap = np.nan_to_num(np.abs(before.values[mine] - after.values[new]), nan=0.0)
            self.difference = max(self.difference, float(np.max(gap, initial=0.0)))
        if whole or not self.whole_passes:
            self.answers = answers
        self.whole_passes += whole

    @property
    def complete(self) -> bool:
        """Whether all expected estimates have been received."""
        return self.tally.lost == 0

    def facts(self, duration_s: float) -> dict[str, str]:
        """Rows for the report."""
        tally, wall_s = self.tally, max(self.wall_s, 1e-9)
        again = ""
        if self.passes > 1:
            again = f", {self.passes} passes, {self.whole_passes} of them whole"
        rows = {
            "path": "estimator node in another process, over DDS",
            "played": f"{self.span_s:.3f} s of {duration_s:.3f} s{again}; ended {self.ending}",
            "inputs sent": f"{tally.sent}",
            "estimates expected": f"{tally.expected}",
            "estimates received": f"{tally.received}",
            "estimates lost": f"{tally.lost}",
            "rate achieved": f"{self.span_s / wall_s:.2f} x real time, "
            f"{tally.sent / wall_s:.0f} inputs/s",
        }
        if self.behind_s > 0:
            rows["latest sending"] = f"{self.behind_s * 1e3:.2f} ms behind the recorded time"
        if self.latency_s.size:
            p50, p99 = np.percentile(self.latency_s, (50, 99)) * 1e3
            rows["latency"] = f"p50 {p50:.2f} ms, p99 {p99:.2f} ms from input sent to answer heard"
        if tally.strange:
            rows["answers not asked for"] = f"{tally.strange}"
        if self.whole_passes > 1:
            rows["between passes"] = f"{self.difference:.3g} at most, over all channels"
        return rows

    def notes(self) -> tuple[str, ...]:
        """Remarks for the report; none if nothing went wrong."""
        tally = self.tally
        found = []
        if tally.lost:
            found.append(f"{tally.lost} expected estimates did not arrive on all three topics.")
        if tally.strange:
            found.append(
                f"{tally.strange} answers belong to no input: another estimator or replay may be "
                "in the same ROS domain."
            )
        if self.answers and (jumps := self.answers.conditioned.clock_jumps):
            found.append(
                f"The clock of the recording went back {jumps} times; where stamps repeat, the "
                "later estimate counts."
            )
        if self.whole_passes > 1 and self.difference > 0:
            found.append(f"Passes differ by up to {self.difference:.3g}; they should be identical.")
        return tuple(found)

    def comparison(self, path: str, recording: Recording) -> BagComparison:
        """Compare with the references in the bag; the result has no channels if there are none."""
        duration_s = (recording.end_ns - recording.start_ns) * 1e-9
        facts, answers = self.facts(duration_s), self.answers
        if answers is None or not recording.references or not answers.estimates.stamp_ns.size:
            counters = counters_of(recording, answers.conditioned) if answers else {}
            notes = (*recording.notes, *self.notes())
            return BagComparison(path, duration_s, (), counters, notes, facts)
        validation = Validation(self.model, path, recording, answers.conditioned)
        for _ in validation.compare([answers.estimates]):
            pass
        return validation.result(facts, self.notes())

    def why_nothing(self, comparison: BagComparison, recording: Recording) -> str:
        """Why nothing was compared, in words; empty if something was."""
        if comparison.compared:
            return ""
        if not recording.references:
            return "the bag has no references; name their topics with --reference"
        answers = self.answers
        if answers is None or not answers.estimates.stamp_ns.size:
            known = answers.conditioned.shortage(self.model.robot) if answers else ""
            return f"no estimate was received{': ' if known else ''}{known}"
        return nothing_beside(answers.estimates.stamp_ns, recording.references)
