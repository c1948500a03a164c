"""Collects the answers of all runs and compares them with the references.  Without ROS."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cdrj_ros.bag import Recording
from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.conditioning.whole_recording import Conditioned
from cdrj_ros.judgement.channels import FORCE_VECTOR, BagComparison
from cdrj_ros.judgement.inputs import counters_of
from cdrj_ros.judgement.validation import ByChannel, compare_with_references
from cdrj_ros.model.prepared import Model
from cdrj_ros.replay.answers import STALLED_S
from cdrj_ros.replay.heard import Floats, Heard, Stamps, Tally, channels_of

KEPT: Final = 1_000_000
"""Maximum number of stored latencies; it bounds the memory of an endless loop."""


@dataclass(eq=False)
class Outcome:
    """All answers to one recording, over all passes.

    If two runs have an answer with the same stamp, the later one is used.
    """

    model: Model
    tally: Tally = field(default_factory=Tally)
    runs: int = 0
    """Number of runs, each of which begins with a reset of the estimator."""
    passes: int = 0
    """Number of runs from the beginning to the end."""
    span_s: float = 0.0
    """Duration of the played parts of the recording, including repetitions [s]."""
    wall_s: float = 0.0
    """Elapsed wall time, without pauses [s]."""
    behind_s: float = 0.0
    """Maximum delay of a message after its due time [s]."""
    ending: str = ""
    """Description of how the last run ended."""
    difference: float = 0.0
    """Maximum difference between whole passes, over all channels [unit of the channel]."""
    refused: Counter[str] = field(default_factory=Counter)
    accepted: int = 0
    clock_jumps: int = 0
    gaps: int = 0
    steps: int = 0
    latency_s: Floats = field(default_factory=lambda: np.empty(0))
    stamp_ns: Stamps = field(default_factory=lambda: np.empty(0, np.int64))
    """Unique stamps of all answers in increasing order [ns], shape (n,)."""

    def __post_init__(self) -> None:
        layout = self.model.layout
        channels = len(channels_of(layout))
        self.value: Floats = np.empty((0, channels))
        self.force: Floats = np.empty((0, 3, len(layout.pulleys)))
        self.stddev: Floats = np.empty((0, channels))
        self.angle: Floats = np.empty((0, len(layout.motors) + len(layout.joints)))

    def add(self, heard: Heard, *, whole: bool) -> None:
        """Add one run; ``whole`` if it went from the beginning to the end."""
        self.runs += 1
        self.tally += heard.tally
        self.refused.update(heard.refused)
        self.accepted += heard.accepted
        self.clock_jumps += heard.clock_jumps
        self.gaps += heard.gaps
        self.steps += heard.steps
        self.latency_s = np.concatenate((self.latency_s, heard.latency_s))[-KEPT:]
        if whole and self.passes:
            _, mine, new = np.intersect1d(self.stamp_ns, heard.stamp_ns, return_indices=True)
            for ours, theirs in ((self.value, heard.value), (self.force, heard.force)):
                gap = np.abs(ours[mine] - theirs[new])
                self.difference = max(self.difference, float(np.max(gap, initial=0.0)))
        self.passes += whole
        # use the later answer, also after a clock jump within a run
        stamps = np.concatenate((heard.stamp_ns[::-1], self.stamp_ns))
        self.stamp_ns, first = np.unique(stamps, return_index=True)
        self.value, self.force, self.stddev, self.angle = (
            np.concatenate((new[::-1], old))[first]
            for new, old in (
                (heard.value, self.value),
                (heard.force, self.force),
                (heard.stddev, self.stddev),
                (heard.angle, self.angle),
            )
        )

    @property
    def complete(self) -> bool:
        """Whether all expected estimates have been received."""
        return self.tally.lost == 0

    def facts(self, duration_s: float) -> dict[str, str]:
        """Rows for the report."""
        tally, wall_s = self.tally, max(self.wall_s, 1e-9)
        again = f", {self.runs} runs, {self.passes} of them whole" if self.runs > 1 else ""
        rows = {
            "path": "estimator node in another process, over DDS",
            "played": f"{self.span_s:.3f} s of {duration_s:.3f} s{again}; ended {self.ending}",
            "inputs sent": f"{tally.sent}",
            "estimates expected": f"{tally.expected}",
            "estimates received": f"{tally.received}",
            "estimates lost": f"{tally.lost}",
            "estimates late": f"{tally.late} (given up after {STALLED_S:g} s, or overtaken)",
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
        if self.passes > 1:
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
        if self.runs > max(self.passes, 1):
            found.append(
                f"The estimator was reset {self.runs} times, each time without a friction "
                "history; where runs overlap, the later one counts."
            )
        if self.clock_jumps:
            found.append(
                f"The clock of the recording went back {self.clock_jumps} times; where stamps "
                "repeat, the later estimate counts."
            )
        if self.passes > 1 and self.difference > 0:
            found.append(f"Passes differ by up to {self.difference:.3g}; they should be identical.")
        return tuple(found)

    def comparison(self, path: str, recording: Recording) -> BagComparison:
        """Compare with the references in the bag; the result has no channels if there are none."""
        layout = self.model.layout
        motors = len(layout.motors)
        samples = Samples(self.stamp_ns, self.angle[:, :motors], self.angle[:, motors:])
        conditioned = Conditioned(
            (samples,), dict(self.refused), self.accepted, self.clock_jumps, self.gaps, self.steps
        )
        duration_s = (recording.end_ns - recording.start_ns) * 1e-9
        facts = self.facts(duration_s)
        if not recording.references or not self.stamp_ns.size:
            return BagComparison(
                path, duration_s, (), counters_of(recording, conditioned),
                (*recording.notes, *self.notes()), facts,
            )  # fmt: skip
        names = channels_of(layout)
        known = np.atleast_1d(np.isfinite(self.stddev).any(axis=0))
        values = dict(zip(names, self.value.T, strict=True))
        values |= {
            f"{FORCE_VECTOR}/{name}": self.force[:, :, k] for k, name in enumerate(layout.pulleys)
        }
        estimates = ByChannel(
            self.stamp_ns.size,
            values,
            {n: self.stddev[:, k] for k, n in enumerate(names) if known[k]},
        )
        return compare_with_references(
            self.model, path, recording, conditioned, self.stamp_ns, estimates, facts, self.notes()
        )
