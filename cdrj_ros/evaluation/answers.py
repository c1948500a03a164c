"""Predicts the estimates that follow from the inputs sent, and collects the answers.

The inputs pass through the same conditioner as in the estimator. The stamp of every expected
estimate is therefore known as soon as its inputs are sent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from time import perf_counter
from typing import Final

import numpy as np

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.estimation.conditioner import TOPICS, Conditioned, Conditioner, Kind, Mode
from cdrj_ros.estimation.estimator import Estimates, Sample, Samples
from cdrj_ros.foundation.arrays import Floats
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.output import listed
from cdrj_ros.messages.cdr import JOINT_STATE, MessageError, read_layout
from cdrj_ros.messages.templates import ESTIMATE_MESSAGES, EstimateMessage
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings.batch import BEFORE, Batch, BulkDecoder

STALLED_S: Final = 10.0
"""Time without an answer after which estimates in flight are given up [s].

Fast DDS may detect the loss of the last message only with its next heartbeat, up to 3 s later, and
the retransmission may fail as well.
"""


class AnotherRobotError(CdrjError):
    """The estimator's names differ from those of the robot file."""


@dataclass(frozen=True)
class Tally:
    """Counters so far."""

    sent: int = 0
    """Published inputs."""
    expected: int = 0
    """Estimates that result from the inputs sent."""
    received: int = 0
    """Estimates of which all three messages have been received."""
    lost: int = 0
    """Expected estimates that were given up, and not received since."""
    strange: int = 0
    """Answers that belong to no input: from another estimator or an earlier run."""

    @property
    def under_way(self) -> int:
        """Estimates in flight, neither received nor lost yet."""
        return self.expected - self.received - self.lost

    @property
    def words(self) -> str:
        """The counters as text: ``5400 sent, 5398 answered, 2 under way, 0 lost``."""
        words = (
            f"{self.sent} sent, {self.received} answered, {self.under_way} under way, "
            f"{self.lost} lost"
        )
        return words + (f", {self.strange} strange" if self.strange else "")

    def __add__(self, other: Tally) -> Tally:
        return Tally(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


@dataclass(frozen=True, eq=False)
class Answers:
    """All answers of one run of the estimator, that is between two resets."""

    tally: Tally
    conditioned: Conditioned
    """The samples whose estimates have been received, in one segment, and what was refused."""
    estimates: Estimates
    """As received, in order of increasing stamps; NaN where a message does not say."""
    latency_s: Floats
    """Time from sending the last input needed to receiving the last of three messages [s],
    shape (n,)."""


class Run:
    """Tracks one run of the estimator: the inputs sent and the answers received."""

    def __init__(self, model: Model, conditioning: Mode = "wait") -> None:
        """Start an empty run; ``conditioning`` is the estimator's mode."""
        self.conditioner = Conditioner(model.robot, conditioning)
        self.trouble: CdrjError | None = None
        """Error because of which the run cannot continue."""
        self.sent = 0
        self.received_s = 0.0
        """Time of the last expected answer [s]; 0 before the first."""
        self.unanswerable = 0
        """Number of inputs sent since the last one that led to an estimate."""
        self._layout = model.layout
        self._asked_s = 0.0
        self._asked: dict[int, tuple[float, tuple[float, ...]]] = {}
        """Time of asking [s], and angles of motors and joints, by stamp."""
        self._payloads: tuple[dict[int, bytes], ...] = tuple({} for _ in ESTIMATE_MESSAGES)
        """Of every topic, by stamp."""
        self._complete: dict[int, float] = {}
        """Time at which all topics had answered [s], by stamp."""
        self._given_up: set[int] = set()
        self._strange = 0

    def asker(self, kind: Kind) -> Callable[[bytes, int], None]:
        """Function to call with every payload sent on one topic, which carries ``kind``.

        It takes the recorded time of arrival [ns], too.
        """
        message = JointStateDecoder()

        def ask(payload: bytes, arrival_ns: int) -> None:
            self.sent += 1
            self.unanswerable += 1
            if not message.decode(payload, arrival_ns):
                self.conditioner.refuse("malformed")
                return
            for fields in self.conditioner.feed_message(TOPICS[kind], message):
                sample = Sample(*fields)
                if not sample.silent:
                    self.unanswerable = 0
                    self._asked_s = perf_counter()
                    angles = (*sample.motor_angle, *sample.joint_angle)
                    self._asked[sample.stamp_ns] = self._asked_s, angles
                    self._forget(sample.stamp_ns)

        return ask

    def _forget(self, stamp: int) -> None:
        """Expect an estimate anew after a jump of the recording's clock."""
        self._complete.pop(stamp, None)
        self._given_up.discard(stamp)
        for payloads in self._payloads:
            payloads.pop(stamp, None)

    def listener(self, number: int) -> Callable[[bytes], None]:
        """Function to call with every payload received on ``ESTIMATE_MESSAGES[number]``."""
        payloads, asked = self._payloads[number], self._asked
        from_bytes = int.from_bytes

        def hear(payload: bytes) -> None:
            stamp = from_bytes(payload[4:8], "little", signed=True) * 1_000_000_000 + from_bytes(
                payload[8:12], "little"
            )
            if stamp not in asked:
                self._strange += bool(asked)
                return
            if stamp in payloads:
                return  # the last one, repeated as STALE during a pause
            if not payloads:
                self._check_names(number, payload)
            payloads[stamp] = payload
            self.received_s = perf_counter()
            if all(stamp in one for one in self._payloads):
                self._complete[stamp] = self.received_s
                self._given_up.discard(stamp)

        return hear

    def _check_names(self, number: int, payload: bytes) -> None:
        topic = ESTIMATE_MESSAGES[number]
        expected = topic.names(self._layout)
        try:
            names = read_layout(payload, topic.message.fields).texts["name"]
        except MessageError as error:
            self.trouble = AnotherRobotError(f"{topic.topic} cannot be read: {error}")
            return
        has_part = topic.message is JOINT_STATE and set(names) < set(expected)
        if names != expected and not has_part:
            self.trouble = AnotherRobotError(
                f"the estimator is of another robot: its {topic.topic} are of "
                f"{listed(names, 4) or 'nothing'}, expected {listed(expected, 4)} as in the robot "
                "file"
            )

    @property
    def under_way(self) -> int:
        """Number of expected estimates not yet received on all topics or given up."""
        return len(self._asked) - len(self._complete) - len(self._given_up)

    def give_up_stalled(self, now_s: float) -> int:
        """Give up the estimates in flight after ``STALLED_S`` of silence; returns their number."""
        waiting = self.under_way
        if not waiting or now_s - max(self._asked_s, self.received_s) <= STALLED_S:
            return 0
        self._given_up.update(self._asked.keys() - self._complete.keys())
        return waiting

    def tally(self) -> Tally:
        """The counters so far."""
        return Tally(
            self.sent, len(self._asked), len(self._complete), len(self._given_up), self._strange
        )

    def finish(self) -> Answers:
        """Return the whole run as arrays; incomplete estimates count as lost."""
        gate, layout = self.conditioner, self._layout
        stamps = sorted(self._complete)
        count, motors = len(stamps), len(layout.motors)
        values = np.full((count, layout.size), np.nan)
        deviations: list[Floats] = []
        for payloads, topic in zip(self._payloads, ESTIMATE_MESSAGES, strict=True):
            names = topic.names(layout)
            block = _decoded([payloads[stamp] for stamp in stamps], topic, names)
            unknown = np.full((count, len(names)), np.nan)
            deviations.append(block.get("stddev", unknown))
            for array in topic.arrays:
                values[:, getattr(layout, array)] = block[array]
        asked_s = [self._asked[stamp][0] for stamp in stamps]
        angle = np.array([self._asked[stamp][1] for stamp in stamps])
        angle = angle.reshape(count, motors + len(layout.joints))
        at = np.array(stamps, np.int64)
        lost = len(self._asked) - count
        return Answers(
            Tally(self.sent, len(self._asked), count, lost, self._strange),
            Conditioned(
                (Samples(at, angle[:, :motors], angle[:, motors:]),), dict(gate.refused),
                gate.accepted, gate.clock_jumps, gate.gaps, gate.steps, gate.ahead,
                gate.take_refused(),
            ),
            Estimates(at, values, layout, np.hstack(deviations)),
            np.array([self._complete[stamp] for stamp in stamps]) - np.array(asked_s),
        )  # fmt: skip


def _decoded(
    payloads: Sequence[bytes], topic: EstimateMessage, names: tuple[str, ...]
) -> dict[str, Floats]:
    """The arrays of messages, shape (n, names) each; NaN for messages with other names."""
    arrays = (*topic.arrays, *(("stddev",) if topic.uncertain else ()))
    decoder = BulkDecoder(topic.message, *arrays)
    length = np.array([len(payload) for payload in payloads], np.int64)
    nothing = np.zeros(len(payloads), np.int64)
    start = BEFORE + np.cumsum(length) - length
    raw = bytes(BEFORE) + b"".join(payloads)
    batch = Batch(raw, nothing.astype(np.uint16), nothing, start, length)
    decoder.add(batch, np.arange(len(payloads)), 0)
    block = np.full((len(arrays), len(payloads), len(names)), np.nan)
    for there, table in decoder.tables.items():
        if not set(there) <= set(names):
            continue
        value = np.concatenate(table.value).reshape(-1, len(there), len(arrays))
        places = [names.index(name) for name in there]
        block[:, np.concatenate(table.arrival)[:, None], places] = np.moveaxis(value, 2, 0)
    return dict(zip(arrays, block, strict=True))
