"""Text for users, with untrusted text escaped, and output and progress that end no command."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from time import monotonic
from typing import Any, Final, TextIO, TypeAlias, cast


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


def listed(names: Sequence[str], most: int = 8) -> str:
    """The first names, and how many more there are."""
    left = len(names) - most
    return ", ".join(names[:most]) + (f" and {left} more" if left > 0 else "")


def said_once(remarks: Iterable[str]) -> list[str]:
    """Remarks that differ in the name at their beginning alone, joined to one with all names."""
    ends = (remark.partition(" ") for remark in remarks)
    return named_once(
        (name.rstrip(":"), f": {rest}" if name.endswith(":") else f" {rest}")
        for name, _, rest in ends
    )


def named_once(remarks: Iterable[tuple[str, str]]) -> list[str]:
    """Remarks with all names of which they are true, from pairs of a name and what follows it."""
    names: dict[str, list[str]] = {}
    for name, rest in remarks:
        names.setdefault(rest, []).append(name)
    return [
        f"{'each of ' if len(own) > 1 and rest[:1] == ' ' else ''}{', '.join(own)}{rest}"
        for rest, own in names.items()
    ]


Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"


def plain(value: Any, fields: Callable[[Any], Mapping[str, Any]] = vars) -> Json:
    """A value as JSON has it: lists for tuples, null for numbers that are not finite.

    ``fields`` gives those of a dataclass by their keys.
    """
    if is_dataclass(value):
        value = fields(value)
    if isinstance(value, Mapping):
        return {str(key): plain(one, fields) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one, fields) for one in value]
    found: Json = value
    return None if isinstance(found, float) and not math.isfinite(found) else found


def json_text(document: Json) -> str:
    """A JSON document as text."""
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def counted(number: int, noun: str) -> str:
    """``1 motor``, ``2 motors``."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def fixed(value: float, decimals: int) -> str:
    """The number with a fixed number of decimals; zero after rounding has no sign."""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


ABSENT: Final = "\N{EN DASH}"
"""Text in place of an unknown figure."""


_MINUS: Final = "\N{MINUS SIGN}"


def format_number(value: float | None, decimals: int) -> str:
    """A figure with that many decimals, or ABSENT."""
    return ABSENT if value is None else f"{value:.{decimals}f}".replace("-", _MINUS)


def format_percent(share: float | None, decimals: int = 2) -> str:
    """A share in percent, with decimals only below 100 %, or ABSENT."""
    if share is None:
        return ABSENT
    return f"{100.0 * share:.{decimals}f} %" if share < 1.0 else f"{100.0 * share:.0f} %"


def format_r2(r2: float | None) -> str:
    """R² with four decimals, or with one where it is far below zero."""
    return format_number(r2, 4 if r2 is None or r2 > -10.0 else 1)


def format_angle(degrees: float | None) -> str:
    """An angle with two digits or more, down to thousandths: "0.25°", "0.001°", "143°"; or ABSENT.

    Angles of a thousandth of a degree are those of rounded numbers.
    """
    if degrees is None:
        return ABSENT
    return f"{format_number(degrees, min(max(decimals_for(degrees) - 1, 0), 3))}°"


def format_amount(value: float | None, unit: str) -> str:
    """A value with two or more digits and its unit, milli-units if small: "0.21 N", "8.4 mN·m"."""
    if value is None:
        return ABSENT
    factor, scaled_unit = scale_for(value, unit)
    decimals = max(decimals_for(factor * value) - 1, 0)
    return f"{format_number(factor * value, decimals)} {scaled_unit}"


def scale_for(largest: float | None, unit: str) -> tuple[float, str]:
    """Factor and unit for numbers up to ``largest`` [unit]: milli-units below 0.1.

    The threshold is 0.0995, which rounds to 0.10 with two digits.
    """
    if largest is not None and 0.0 < largest < 0.0995 and " or " not in unit:
        return 1e3, f"m{unit}"
    return 1.0, unit


def decimals_for(magnitude: float) -> int:
    """Decimals that show three digits of a number of this magnitude: 2 for 4.2, 4 for 0.042."""
    if not magnitude > 0.0:
        return 2
    return min(max(2 - math.floor(math.log10(magnitude)), 0), 9)


LINE_S: Final = 5.0
"""Time between two lines of progress without a terminal [s]."""

REFRESH_S: Final = 0.1
"""Time between two updates of a bar in a terminal [s]."""


class ProgressBar:
    """Progress on standard error: a bar in a terminal, otherwise a line now and then.

    It has no thread: it is drawn within its block when it is called, at most as often as due.
    """

    def __init__(self, description: str = "", total: float | None = None) -> None:
        """Begin with nothing done, as ``begin`` does."""
        self._shown: Any = None
        self._task: Any = None
        self.begin(description, total)

    def begin(self, description: str, total: float | None = None) -> None:
        """Begin something new, of which ``total`` is to be done; None if that is not known."""
        self._description, self._total = description, total
        self._begin_s = monotonic()
        self._next_s = self._begin_s + (LINE_S if self._shown is None else 0.0)
        if self._shown is not None:
            self._shown.reset(self._task, total=total, description=description, text="")

    def __enter__(self) -> ProgressBar:
        """Draw the bar from here on if standard error is a terminal."""
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            Progress,
            TaskProgressColumn,
            TextColumn,
            TimeRemainingColumn,
        )

        console = Console(file=sys.stderr, highlight=False)
        if console.is_terminal:
            self._shown = Progress(
                TextColumn("{task.description}"), BarColumn(16),
                TaskProgressColumn("{task.percentage:>3.0f} %"), TimeRemainingColumn(),
                TextColumn("{task.fields[text]}", markup=False), console=console, transient=True,
                auto_refresh=False,
            )  # fmt: skip
            self._task = self._shown.add_task(self._description, total=self._total, text="")
            self._next_s = 0.0
            self._shown.start()
        return self

    def __exit__(self, *_error: object) -> None:
        """Remove the bar."""
        if self._shown is not None:
            self._shown.stop()
            self._shown = None

    def is_due(self) -> bool:
        """Whether a call would draw."""
        return monotonic() >= self._next_s

    def __call__(self, done: float, text: str = "") -> None:
        """Show what has been done, in the unit of the total, and a text beside it."""
        now, due = monotonic(), self.is_due()
        if self._shown is not None:
            self._next_s = now + REFRESH_S if due else self._next_s
            self._shown.update(self._task, completed=done, text=text, refresh=due)
        elif due:
            self._next_s = now + LINE_S
            words = [text] if text else []
            if self._total is not None:
                share = done / max(self._total, 1e-9)
                left = (now - self._begin_s) * (1.0 / share - 1.0) if share >= 0.01 else 0.0
                remaining = [f"{left:.0f} s left"] if left >= 0.5 else []
                words = [f"{100.0 * share:.0f} %", *remaining, *words]
            self.say(f"{self._description}: {', '.join(words)}")

    def say(self, words: str) -> None:
        """Print a line, above the bar if there is one."""
        if self._shown is not None:
            self._shown.console.print(words, markup=False)
        else:
            print(words, file=sys.stderr, flush=True)
