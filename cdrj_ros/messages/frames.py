"""One message in memory, so placed that its numbers can be read and written as words.

CDR aligns numbers to multiples of their size from the end of the four encapsulation bytes.  A frame
has four bytes before the message, so that numbers of 8 bytes are words of its memory.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.messages.cdr import ENCAPSULATION

BEFORE: Final = 8 - ENCAPSULATION
"""Bytes before the message."""


class Frame:
    """Memory for messages of one length, and views of it."""

    def __init__(self, length: int, words: NDArray[np.int64] | None = None) -> None:
        """Fill the frame with zeros.

        Args:
            length: of the message, encapsulation included [bytes].
            words: the memory to use, shape (words_of(length),); None: new memory.
        """
        if words is None:
            words = np.empty(words_of(length), dtype=np.int64)
        words[:] = 0
        self.words: NDArray[np.int64] = words
        """All bytes, as integers; those that are not the message's are zero."""
        self.numbers: NDArray[np.float64] = words.view(np.float64)
        """All bytes, as floats."""
        self.payload = memoryview(words.view(np.uint8))[BEFORE : BEFORE + length]  # type: ignore[arg-type]
        """The message."""


def words_of(length: int) -> int:
    """Words of a frame for messages of a length [bytes]."""
    return -(-(BEFORE + length) // 8)


def word_of(offset: int) -> int:
    """Word of a number of 8 bytes at an offset in the message, encapsulation included [bytes]."""
    return (BEFORE + offset) // 8
