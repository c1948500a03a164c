"""Progress display on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any, Final

LINE_S: Final = 5.0
"""Time between two lines of progress without a terminal [s]."""

REFRESH_S: Final = 0.1
"""Time between two updates of a ``LabelledBar`` in a terminal [s]."""


def _lines(description: str, total: float) -> Callable[[float], None]:
    """Progress without a terminal: one line every LINE_S."""
    begin = last = monotonic()

    def report(done: float) -> None:
        nonlocal last
        if monotonic() - last > LINE_S:
            last = monotonic()
            share = done / max(total, 1e-9)
            left = (last - begin) * (1.0 / share - 1.0) if share >= 0.01 else 0.0
            remaining = f", {left:.0f} s left" if left >= 0.5 else ""
            text = f"{description}: {100.0 * share:.0f} %{remaining}"
            print(text, file=sys.stderr, flush=True)

    return report


@contextmanager
def progress_bar(description: str, total: float) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on standard error; yields a function that takes the amount done."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(file=sys.stderr)
    if not console.is_terminal:
        yield _lines(description, total)
        return
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(), console=console, transient=True,
    ) as progress:  # fmt: skip
        task = progress.add_task(description, total=total)
        yield lambda done: progress.update(task, completed=done)


@contextmanager
def progress_text(lasts: Callable[[str], bool]) -> Iterator[Callable[[str], None]]:
    """Show the current activity on standard error; yields a function that takes a line of text.

    Args:
        lasts: whether a line stays on the screen; other lines replace each other in a terminal, and
            without a terminal are printed at most every ``LINE_S``.
    """
    from rich.console import Console
    from rich.text import Text

    console = Console(file=sys.stderr, highlight=False)
    if not console.is_terminal:
        last = monotonic()

        def occasionally(text: str) -> None:
            nonlocal last
            if lasts(text) or monotonic() - last > LINE_S:
                last = monotonic()
                print(text, file=sys.stderr, flush=True)

        yield occasionally
        return
    with console.status("") as status:

        def show(text: str) -> None:
            if lasts(text):
                console.print(Text(text))
            else:
                status.update(Text(text))

        yield show


class LabelledBar:
    """A bar between two texts, without a thread: only ``show`` redraws it, at most as often as due.

    Outside ``drawn`` and without a terminal it is a line of text instead.
    """

    def __init__(self) -> None:
        self._progress: Any = None
        self._task: Any = None
        self._next_s = 0.0

    def is_due(self, now_s: float) -> bool:
        """Whether ``show`` would draw."""
        return now_s >= self._next_s

    def show(self, now_s: float, label: str, done: float, total: float, text: str) -> None:
        """Draw, unless it has been drawn only ``REFRESH_S`` or ``LINE_S`` ago.

        Args:
            now_s: time of any clock, always the same one [s].
            label: text before the bar.
            done, total: length of the bar, in any unit.
            text: text after the bar.
        """
        if not self.is_due(now_s):
            return
        if self._progress is None:
            self._next_s = now_s + LINE_S
            print(f"{label}: {text}", file=sys.stderr, flush=True)
            return
        self._next_s = now_s + REFRESH_S
        self._progress.update(
            self._task, description=label, total=max(total, 1e-9), completed=done, text=text
        )
        self._progress.refresh()

    def say(self, words: str) -> None:
        """Print a line above the bar; without a bar, on standard output."""
        if self._progress is not None:
            self._progress.console.print(words, markup=False, highlight=False)
        else:
            print(words, flush=True)

    @contextmanager
    def drawn(self, now_s: float) -> Iterator[None]:
        """Draw the bar within the block if standard error is a terminal."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        console = Console(file=sys.stderr)
        if not console.is_terminal:
            self._next_s = now_s + LINE_S
            yield
            return
        self._next_s = now_s
        with Progress(
            TextColumn("{task.description}"), BarColumn(bar_width=16),
            TextColumn("{task.fields[text]}"), console=console, transient=True, auto_refresh=False,
        ) as progress:  # fmt: skip
            self._progress = progress
            self._task = progress.add_task("waiting", total=1.0, text="")
            try:
                yield
            finally:
                self._progress = None
