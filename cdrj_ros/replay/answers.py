"""Predicts the estimates expected for the inputs sent and matches answers.  Without ROS.

The inputs pass through the same conditioner as in the estimator.  The stamp and the order of every
expected estimate and the time of its request are therefore known as soon as its inputs are sent.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Final

import numpy as np

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.conditioning.conditioner import Conditioner, Kind, Mode
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.messages.cdr import (
    MessageError,
    read_layout,
)
from cdrj_ros.model.prepared import Model
from cdrj_ros.replay.heard import Floats, Heard, Tally
from cdrj_ros.replay.line import FOLD, FORCES, KINDS, Line, names_of

STALLED_S: Final = 10.0
"""Time without an answer after which estimates in flight count as lost [s]; if such an estimate is
received later, it counts as late.

Fast DDS may detect the loss of the last message only with its next heartbeat, up to 3 s later, and
the retransmission may fail as well.
"""

NEVER: Final = 2**63
"""A place beyond that of any answer."""


class AnotherRobotError(CdrjError):
    """The estimator's names differ from those of the robot file."""


class Run:
    """Tracks one run of the estimator: the inputs sent and the answers received."""

    def __init__(self, model: Model, conditioning: Mode = "wait") -> None:
        """Start an empty run; ``conditioning`` is the estimator's mode."""
        self.conditioner = Conditioner(model.robot, conditioning)
        self.trouble: CdrjError | None = None
        """Error because of which the run cannot continue."""
        self.sent = 0
        self.strange = 0
        self.heard_s = 0.0
        """Time of the last expected answer [s]; 0 before the first."""
        self._layout = model.layout
        self._expected = array("q")
        self._asked_s = array("d")
        self._angle = array("d")
        self._lines = [
            Line(kind, names) for kind, names in zip(KINDS, names_of(model.layout), strict=True)
        ]
        self._late: set[int] = set()
        self._room_at = NEVER
        self._on_room: Callable[[], None] = _nothing
        self._unanswerable = 0

    # -- inputs --------------------------------------------------------------------------------

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

    # -- answers -------------------------------------------------------------------------------

    def listener(self, number: int) -> Callable[[bytes], None]:
        """Function to call with every payload received on the topic of ``KINDS[number]``."""
        line, expected = self._lines[number], self._expected
        keep, note = line.payloads.append, line.heard_s.append
        from_bytes = int.from_bytes

        def hear(payload: bytes) -> None:
            stamp = from_bytes(payload[4:8], "little", signed=True) * 1_000_000_000 + from_bytes(
                payload[8:12], "little"
            )
            place = line.place
            if place >= len(expected) or expected[place] != stamp:
                found = self._find(line, stamp)
                if found is None:
                    return
                place = found
            else:
                line.place = place + 1
            if not line.count:
                self._check_names(line, payload)
            line.count += 1
            line.index.append(place)
            now = perf_counter()
            note(now)
            self.heard_s = now
            keep(payload)
            if place >= self._room_at:
                self._room_at = NEVER
                self._on_room()
            if len(line.payloads) >= FOLD:
                line.fold()

        return hear

    def _find(self, line: Line, stamp: int) -> int | None:
        """Index of an answer that is not the next one expected; None if it was not expected."""
        late = line.given_up.pop(stamp, None)
        if late is not None:
            self._late.add(late)
            return late
        try:
            place = self._expected.index(stamp, line.place)
        except ValueError:
            again = line.place > 0 and self._expected[line.place - 1] == stamp
            if self._expected and not again:  # the last one, repeated as STALE during a pause
                self.strange += 1
            return None
        for skipped in range(line.place, place):
            line.given_up[self._expected[skipped]] = skipped
        line.place = place + 1
        return place

    def _check_names(self, line: Line, payload: bytes) -> None:
        try:
            names = read_layout(payload, line.kind.message.fields).texts["name"]
        except MessageError as error:
            self.trouble = AnotherRobotError(f"{line.kind.topic} cannot be read: {error}")
            return
        if names != line.names:
            self.trouble = AnotherRobotError(
                f"the estimator is of another robot: its {line.kind.topic} are of "
                f"{_listed(names)}, expected {_listed(line.names)} as in the robot file"
            )

    # -- state ---------------------------------------------------------------------------------

    @property
    def under_way(self) -> int:
        """Number of expected estimates not yet received or given up on all topics."""
        lines = self._lines
        return len(self._expected) - min(lines[0].place, lines[1].place, lines[2].place)

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
        if now_s - max(oldest_s, self.heard_s) <= patience_s:
            return 0
        for line in self._lines:
            for place in range(line.place, len(self._expected)):
                line.given_up[self._expected[place]] = place
            line.place = len(self._expected)
        return waiting

    def tally(self) -> Tally:
        """The counters so far."""
        received = min(line.count for line in self._lines)
        lost = len(self._expected) - self.under_way - received
        return Tally(
            self.sent, len(self._expected), received, max(lost, 0), len(self._late), self.strange
        )

    def finish(self) -> Heard:
        """Return the whole run as arrays; incomplete estimates count as lost."""
        n = len(self._expected)
        blocks: list[Floats] = []
        last_s = np.zeros(n)
        for line in self._lines:
            line.fold()
            block = np.full((line.rows, n, len(line.names)), np.nan)
            heard = np.full(n, np.nan)
            index = np.frombuffer(line.index, np.int64)
            if index.size:
                block[:, index] = np.concatenate(line.blocks, axis=1)
                heard[index] = np.frombuffer(line.heard_s, np.float64)
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
        return Heard(
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
