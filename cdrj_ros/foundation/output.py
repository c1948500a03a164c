"""Text for users, with untrusted text escaped, and output whose failure does not end a command."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast


def say(text: object = "", *, file: TextIO | None = None, flush: bool = False) -> None:
    """Print text with control characters escaped, since it may contain names from files."""
    lines = "\n".join(printable(line) for line in str(text).split("\n"))
    print(lines, file=file, flush=flush)


class LastingStream:
    """A text stream whose failures are stored instead of raised.

    After a failure (a closed pipe, a full disk, a closed descriptor) all output is discarded.
    Characters that the encoding lacks are escaped.
    """

    def __init__(self, stream: Any) -> None:
        """Wrap ``stream``; None if the process has no such stream."""
        self._stream = stream
        self.failure: OSError | ValueError | None = None
        with contextlib.suppress(AttributeError, ValueError):
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        """Write, or discard after a failure."""
        if self._stream is not None and self.failure is None:
            try:
                self._stream.write(self._encodable(text))
            except (OSError, ValueError) as error:
                self._fail(error)
        return len(text)

    def flush(self) -> None:
        """Flush, or do nothing after a failure."""
        if self._stream is not None and self.failure is None:
            try:
                self._stream.flush()
            except (OSError, ValueError) as error:
                self._fail(error)

    def isatty(self) -> bool:
        """Whether this is a terminal and output has not failed."""
        try:
            return self.failure is None and bool(self._stream is not None and self._stream.isatty())
        except ValueError:
            return False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _encodable(self, text: str) -> str:
        encoding = getattr(self._stream, "encoding", None) or "utf-8"
        return text.encode(encoding, "backslashreplace").decode(encoding)

    def _fail(self, error: OSError | ValueError) -> None:
        """Discard all further output, including what is still buffered."""
        self.failure = error
        with contextlib.suppress(OSError, ValueError, AttributeError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


@contextlib.contextmanager
def lasting_output(name: str) -> Iterator[None]:
    """Prevent failures of standard output and standard error from ending the block.

    Args:
        name: name of the command, for a line on standard error if output failed for a reason
            other than a closed pipe.
    """
    out, err = LastingStream(sys.stdout), LastingStream(sys.stderr)
    with (
        contextlib.redirect_stdout(cast("TextIO", out)),
        contextlib.redirect_stderr(cast("TextIO", err)),
    ):
        try:
            yield
        finally:
            out.flush()
            failure = out.failure
            if isinstance(failure, OSError) and failure.errno != errno.EPIPE:
                say(
                    f"{name}: standard output: {failure.strerror}; the rest is not shown",
                    file=sys.stderr,
                )
            err.flush()


def printable(text: object) -> str:
    """The text with every control, format or unpaired surrogate character escaped.

    Names, keys and paths may come from untrusted files.  An ANSI escape in one of them must not
    reach a terminal, and a line break must not split a one-line message.
    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def counted(number: int, noun: str) -> str:
    """``1 motor``, ``2 motors``."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def fixed(value: float, decimals: int) -> str:
    """The number with a fixed number of decimals; zero after rounding has no sign."""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text
