"""Messages of one topic about which nothing is special.  Does not depend on ROS."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.conditioning.conditioner import Conditioner
from cdrj_ros.conditioning.ordinary_kernel import NOT_ORDINARY, Message, Pattern
from cdrj_ros.messages.decoders import KnownJointState
from cdrj_ros.messages.frames import Frame, word_of

KEPT: Final = 8
"""Maximum number of layouts with the same length; several senders may share a topic."""

LENGTHS: Final = 16
"""Maximum number of lengths of messages."""


class Prepared(NamedTuple):
    """A layout of messages that may be ordinary."""

    known: KnownJointState
    pattern: Pattern
    accepted: int
    """Number of names that are channels of the topic."""
    elsewhere: int
    """Number of names that are channels of other topics."""
    unknown: int
    """Number of other names."""


class Family(NamedTuple):
    """Layouts of messages of one length."""

    message: Message
    payload: memoryview
    """Its memory, where a message is copied to."""
    layouts: list[Prepared]


def _family(length: int) -> Family:
    frame = Frame(length)
    return Family(Message(frame.words, frame.numbers), frame.payload, [])


class OrdinaryTopic:
    """Gives ordinary messages to a conditioner without decoding them in Python."""

    def __init__(self, conditioner: Conditioner, kind: str) -> None:
        """Know no layout yet.

        Args:
            conditioner: takes the readings.
            kind: ``motors``, ``joints`` or ``both``.
        """
        self._conditioner, self._ordinary = conditioner, conditioner.ordinary
        self._index = conditioner.index_of(kind)
        self._layouts: dict[int, Family] = {}
        self.known: KnownJointState
        """Layout of the last message taken."""

    def take(self, payload: bytes) -> int:
        """Take a message if it is ordinary, see ``take_ordinary``."""
        if not self._ordinary.loaded:
            return NOT_ORDINARY
        found = self._layouts.get(len(payload))
        if found is None:
            return NOT_ORDINARY
        message, memory, layouts = found
        memory[:] = payload
        for known, pattern, accepted, elsewhere, unknown in layouts:
            stamp = self._ordinary.take(message, pattern)
            if stamp != NOT_ORDINARY:
                self.known = known
                conditioner = self._conditioner
                conditioner.accepted += accepted
                if elsewhere or unknown:
                    conditioner.elsewhere += elsewhere
                    conditioner.refused["unknown_name"] += unknown
                return stamp
        return NOT_ORDINARY

    def learn(self, known: KnownJointState) -> None:
        """Take messages of this layout from now on, if they can be ordinary."""
        family = self._layouts.get(known.length) or _family(known.length)
        if any(known is one.known for one in family.layouts) or not self._is_usable(known):
            return
        family.layouts.insert(0, self._prepare(known))
        del family.layouts[KEPT:]
        if len(self._layouts) >= LENGTHS:
            self._layouts.clear()
        self._layouts[known.length] = family

    def _is_usable(self, known: KnownJointState) -> bool:
        """Whether the numbers can be read as they are, and every channel occurs at most once."""
        channels = [name for name in known.names if name in self._index]
        return known.dtype.isnative and 0 < len(channels) == len(set(channels))

    def _prepare(self, known: KnownJointState) -> Prepared:
        shared, mask = Frame(known.length), Frame(known.length)
        fixed = ((0, known.representation), (12, known.head))
        for begin, part in (*fixed, *((begin, part) for begin, _, part in known.tail)):
            end = begin + len(part)
            shared.payload[begin:end], mask.payload[begin:end] = part, b"\xff" * len(part)
        channels = np.array([self._index.get(name, -1) for name in known.names], dtype=np.int64)
        elsewhere = sum(
            name not in self._index and name in self._conditioner.index_of("both")
            for name in known.names
        )
        accepted = int(np.count_nonzero(channels >= 0))
        pattern = Pattern(shared.words, mask.words, word_of(known.head_stop), channels)
        unknown = len(known.names) - accepted - elsewhere
        return Prepared(known, pattern, accepted, elsewhere, unknown)
