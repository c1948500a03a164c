"""Predicts the estimates that follow from the inputs sent, and collects the answers.

The inputs pass through the same conditioner as in the estimator.  The stamp and the order of every
expected estimate and the time of its request are therefore known as soon as its inputs are sent.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, field
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.estimation.conditioner import Conditioner, Kind, Mode
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.messages import topics
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    FORCE_COMPONENTS,
    JOINT_STATE,
    NODAL_FORCES,
    MessageError,
    MessageType,
    read_layout,
)
from cdrj_ros.model.channels import channel_columns
from cdrj_ros.model.prepared import Layout, Model

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

STALLED_S: Final = 10.0
"""Time without an answer after which estimates in flight count as lost [s]; if such an estimate is
received later, it counts as late.

Fast DDS may detect the loss of the last message only with its next heartbeat, up to 3 s later, and
the retransmission may fail as well.
"""

NEVER: Final = 2**63
"""An index beyond that of any estimate."""

FOLD: Final = 1024
"""Number of messages decoded at once."""


class AnotherRobotError(CdrjError):
    """The estimator's names differ from those of the robot file."""


def channels_of(layout: Layout) -> list[str]:
    """The compared channels, in the order of the columns of ``Answers.value``."""
    return list(channel_columns(layout))


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
    """Expected estimates that were given up or skipped by a later one."""
    late: int = 0
    """Estimates received after they were counted as lost; they no longer count as lost."""
    strange: int = 0
    """Answers that belong to no input: from another estimator or an earlier run."""

    @property
    def under_way(self) -> int:
        """Estimates in flight, neither received nor lost yet."""
        return self.expected - self.received - self.lost

    @property
    def words(self) -> str:
        """The counters as text: ``5400 sent, 5398 answered, 2 under way, 0 lost, 0 late``."""
        words = (
            f"{self.sent} sent, {self.received} answered, {self.under_way} under way, "
            f"{self.lost} lost, {self.late} late"
        )
        return words + (f", {self.strange} strange" if self.strange else "")

    def __add__(self, other: Tally) -> Tally:
        return Tally(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


@dataclass(frozen=True, eq=False)
class Answers:
    """All answers of one run of the estimator, that is between two resets."""

    tally: Tally
    stamp_ns: Stamps
    """Stamps of the complete answers in the order expected [ns], shape (n,)."""
    value: Floats
    """Estimates of ``channels_of`` the robot, shape (n, channels)."""
    force: Floats
    """Components x, y and z of the nodal forces [N], shape (n, 3, pulleys)."""
    latency_s: Floats
    """Time from sending the last input needed to receiving the last of three messages [s],
    shape (n,)."""
    stddev: Floats
    """Standard deviation of ``value``; NaN where the estimator gives none."""
    angle: Floats
    """Motor and joint positions of the samples [rad or m], shape (n, motors + joints)."""
    accepted: int
    """Number of readings that the conditioner accepted."""
    refused: dict[str, int]
    """Number of readings that the conditioner refused, by cause."""
    clock_jumps: int
    """Number of backward jumps of the recording's clock."""
    gaps: int
    """Number of long gaps in a channel."""
    steps: int = 0
    """Number of steps of a channel's readings that exceed the axis' possible motion."""


class AnswerTopic(NamedTuple):
    """One of the topics on which an estimator answers."""

    name: str
    message: MessageType
    arrays: tuple[str, ...]
    """Names of the arrays that are compared; the standard deviations are those of the first."""


ANSWER_TOPICS: Final = (
    AnswerTopic(topics.TENSIONS, CABLE_TENSIONS, ("tension",)),
    AnswerTopic(topics.NODAL_FORCES, NODAL_FORCES, ("magnitude", *FORCE_COMPONENTS)),
    AnswerTopic(topics.EFFORTS, JOINT_STATE, ("effort",)),
)
FORCES: Final = 1
"""Index of the nodal forces in ``ANSWER_TOPICS``."""


def names_of(layout: Layout) -> tuple[tuple[str, ...], ...]:
    """Names in the messages of each topic, in the order of ``ANSWER_TOPICS``."""
    return layout.elements, layout.pulleys, layout.motors + layout.joints


@dataclass
class Received:
    """The answers on one topic."""

    topic: AnswerTopic
    names: tuple[str, ...]
    next: int = 0
    """Index of the estimate expected next on this topic."""
    count: int = 0
    """Number of estimates received on this topic."""
    given_up: dict[int, int] = field(default_factory=dict)
    """Indices of the estimates given up, by stamp [ns]."""
    index: array[int] = field(default_factory=lambda: array("q"))
    """Indices of the estimates of the messages, in order of arrival."""
    received_s: array[float] = field(default_factory=lambda: array("d"))
    payloads: list[bytes] = field(default_factory=list)
    """Messages not yet decoded."""
    blocks: list[Floats] = field(default_factory=list)
    """Values of all arrays and the standard deviations, shape (arrays + 1, m, names) each."""

    @property
    def rows(self) -> int:
        """Number of arrays that are kept, with the standard deviations."""
        return len(self.topic.arrays) + 1

    def fold(self) -> None:
        """Decode the stored payloads; a payload with unexpected names becomes NaN."""
        if not self.payloads:
            return
        block = np.full((self.rows, len(self.payloads), len(self.names)), np.nan)
        lengths = np.fromiter(map(len, self.payloads), np.int64, len(self.payloads))
        for length in np.unique(lengths).tolist():
            rows = np.flatnonzero(lengths == length)
            block[:, rows] = self._decode([self.payloads[k] for k in rows])
        self.blocks.append(block)
        self.payloads.clear()

    def _decode(self, payloads: Sequence[bytes]) -> Floats | float:
        """Decode payloads of equal length; NaN if their names differ from the expected ones."""
        layout = read_layout(payloads[0], self.topic.message.fields)
        if layout.texts["name"] != self.names:
            return np.nan
        octets = np.frombuffer(b"".join(payloads), np.uint8).reshape(len(payloads), -1)
        block = np.full((self.rows, len(payloads), len(self.names)), np.nan)
        for row, name in enumerate((*self.topic.arrays, "stddev")):
            span = layout.numbers.get(name)
            if span is not None and span.count == len(self.names):
                wanted = np.ascontiguousarray(octets[:, span.offset : span.offset + 8 * span.count])
                block[row] = wanted.view(span.dtype)
        return block


class Run:
    """Tracks one run of the estimator: the inputs sent and the answers received."""

    def __init__(self, model: Model, conditioning: Mode = "wait") -> None:
        """Start an empty run; ``conditioning`` is the estimator's mode."""
        self.conditioner = Conditioner(model.robot, conditioning)
        self.trouble: CdrjError | None = None
        """Error because of which the run cannot continue."""
        self.sent = 0
        self.strange = 0
        self.received_s = 0.0
        """Time of the last expected answer [s]; 0 before the first."""
        self._layout = model.layout
        self._expected = array("q")
        self._asked_s = array("d")
        self._angle = array("d")
        self._received = [
            Received(topic, names)
            for topic, names in zip(ANSWER_TOPICS, names_of(model.layout), strict=True)
        ]
        self._late: set[int] = set()
        self._room_at = NEVER
        self._on_room: Callable[[], None] = _nothing
        self._unanswerable = 0

    def asker(self, kind: Kind) -> Callable[[bytes], None]:
        """Function to call with every payload sent on one topic, which carries ``kind``."""
        message = JointStateDecoder()

        def ask(payload: bytes) -> None:
            self.sent += 1
            self._unanswerable += 1
            if not message.decode(payload):
                self.conditioner.refuse("malformed")
                return
            for sample in self.conditioner.take(kind, message):
                if sample.silent:
                    continue
                self._unanswerable = 0
                self._expected.append(sample.stamp_ns)
                self._asked_s.append(perf_counter())
                self._angle.extend(sample.motor_angle)
                self._angle.extend(sample.joint_angle)

        return ask

    @property
    def unanswerable(self) -> int:
        """Number of inputs sent since the last one that led to an estimate."""
        return self._unanswerable

    def listener(self, number: int) -> Callable[[bytes], None]:
        """Function to call with every payload received on ``ANSWER_TOPICS[number]``."""
        answers, expected = self._received[number], self._expected
        keep, note = answers.payloads.append, answers.received_s.append
        from_bytes = int.from_bytes

        def hear(payload: bytes) -> None:
            stamp = from_bytes(payload[4:8], "little", signed=True) * 1_000_000_000 + from_bytes(
                payload[8:12], "little"
            )
            index = answers.next
            if index >= len(expected) or expected[index] != stamp:
                found = self._find(answers, stamp)
                if found is None:
                    return
                index = found
            else:
                answers.next = index + 1
            if not answers.count:
                self._check_names(answers, payload)
            answers.count += 1
            answers.index.append(index)
            now = perf_counter()
            note(now)
            self.received_s = now
            keep(payload)
            if index >= self._room_at:
                self._room_at = NEVER
                self._on_room()
            if len(answers.payloads) >= FOLD:
                answers.fold()

        return hear

    def _find(self, answers: Received, stamp: int) -> int | None:
        """Index of an answer that is not the next one expected; None if it was not expected."""
        late = answers.given_up.pop(stamp, None)
        if late is not None:
            self._late.add(late)
            return late
        try:
            index = self._expected.index(stamp, answers.next)
        except ValueError:
            again = answers.next > 0 and self._expected[answers.next - 1] == stamp
            if self._expected and not again:  # the last one, repeated as STALE during a pause
                self.strange += 1
            return None
        for skipped in range(answers.next, index):
            answers.given_up[self._expected[skipped]] = skipped
        answers.next = index + 1
        return index

    def _check_names(self, answers: Received, payload: bytes) -> None:
        try:
            names = read_layout(payload, answers.topic.message.fields).texts["name"]
        except MessageError as error:
            self.trouble = AnotherRobotError(f"{answers.topic.name} cannot be read: {error}")
            return
        if names != answers.names:
            self.trouble = AnotherRobotError(
                f"the estimator is of another robot: its {answers.topic.name} are of "
                f"{_listed(names)}, expected {_listed(answers.names)} as in the robot file"
            )

    @property
    def under_way(self) -> int:
        """Number of expected estimates not yet received or given up on all topics."""
        tensions, forces, efforts = self._received
        return len(self._expected) - min(tensions.next, forces.next, efforts.next)

    def call_at(self, under_way: int, then: Callable[[], None]) -> None:
        """Call ``then`` once, when about ``under_way`` estimates remain in flight."""
        self._on_room = then
        self._room_at = len(self._expected) - 1 - under_way

    def give_up_stalled(self, now_s: float, patience_s: float = STALLED_S) -> int:
        """Give up the estimates in flight after ``patience_s`` of silence; returns their number."""
        waiting = self.under_way
        if not waiting:
            return 0
        oldest_s = self._asked_s[len(self._expected) - waiting]
        if now_s - max(oldest_s, self.received_s) <= patience_s:
            return 0
        for answers in self._received:
            for index in range(answers.next, len(self._expected)):
                answers.given_up[self._expected[index]] = index
            answers.next = len(self._expected)
        return waiting

    def tally(self) -> Tally:
        """The counters so far."""
        received = min(answers.count for answers in self._received)
        lost = len(self._expected) - self.under_way - received
        return Tally(
            self.sent, len(self._expected), received, max(lost, 0), len(self._late), self.strange
        )

    def finish(self) -> Answers:
        """Return the whole run as arrays; incomplete estimates count as lost."""
        n = len(self._expected)
        blocks: list[Floats] = []
        last_s = np.zeros(n)
        for answers in self._received:
            answers.fold()
            block = np.full((answers.rows, n, len(answers.names)), np.nan)
            heard = np.full(n, np.nan)
            index = np.frombuffer(answers.index, np.int64)
            if index.size:
                block[:, index] = np.concatenate(answers.blocks, axis=1)
                heard[index] = np.frombuffer(answers.received_s, np.float64)
            blocks.append(block)
            last_s = np.maximum(last_s, heard)  # NaN where one of the three is missing
        complete = np.isfinite(last_s)
        value, stddev = (
            np.concatenate([block[row][complete] for block in blocks], axis=1) for row in (0, -1)
        )
        components = np.moveaxis(blocks[FORCES][1:-1], 0, 1)[complete]
        received = int(np.count_nonzero(complete))
        late = int(np.count_nonzero(complete[list(self._late)]))
        layout, gate = self._layout, self.conditioner
        axes = len(layout.motors) + len(layout.joints)
        return Answers(
            tally=Tally(self.sent, n, received, n - received, late, self.strange),
            stamp_ns=np.array(self._expected, np.int64)[complete],
            value=value,
            force=components,
            latency_s=(last_s - np.array(self._asked_s))[complete],
            stddev=stddev,
            angle=np.array(self._angle).reshape(n, axes)[complete],
            accepted=gate.accepted,
            refused=gate.refused,
            clock_jumps=gate.clock_jumps,
            gaps=gate.gaps,
            steps=gate.steps,
        )


def _nothing() -> None:
    """Do nothing."""


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:4])
    return f"{shown}, ... ({len(names)} in all)" if len(names) > 4 else shown or "nothing"
