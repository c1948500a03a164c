"""Tensions as a live table in a terminal, or as one line of text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import TYPE_CHECKING, Final

from rich import box
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.segment import Segment
from rich.style import Style
from rich.table import Table
from rich.text import Text

from cdrj_ros.foundation.text import printable
from cdrj_ros.model.status import INVALID, OK, OVERLOAD, SLACK, STALE, UNSURE

if TYPE_CHECKING:
    from rich.console import JustifyMethod

STATUS: Final = (
    (INVALID, "INVALID", "bold red"),
    (OVERLOAD, "OVERLOAD", "bold red"),
    (STALE, "STALE", "magenta"),
    (SLACK, "SLACK", "cyan"),
    (UNSURE, "UNSURE", "yellow"),
)
"""Flag, word and style of every status, most severe first."""

FINE: Final = ("OK", "green")
"""Word and style of an entry without any flag."""

NARROW: Final = 72
"""Terminal width below which the columns of names and statuses are narrower [columns]."""

SIGMAS: Final = 2.0
"""Half width of the displayed interval [standard deviations]."""

SLOW_S: Final = 0.1
"""Age above which a message is drawn in a warning colour [s]."""

SCALES: Final = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0)
"""Full scales of a bar, times a power of ten."""

FOREIGN_S: Final = 3600.0
"""Age beyond which a stamp is attributed to another clock, for example a recording's [s]."""


@dataclass(frozen=True)
class Line:
    """One element or pulley."""

    name: str
    value: float
    """Tension or force [N]."""
    stddev: float | None
    """Standard deviation [N]; None if unknown."""
    status: int
    """Bitwise combination of the flags of cdrj_msgs/CableTensions."""
    limit: float = float("inf")
    """Value at the full length of the bar [N]; infinite if there is no limit."""

    @property
    def valid(self) -> bool:
        """Whether the value is finite and not marked INVALID."""
        return not self.status & INVALID and isfinite(self.value)

    @property
    def spread(self) -> float | None:
        """Half width of the displayed interval around the value [N]; None if unknown."""
        if self.stddev is None or not isfinite(self.stddev):
            return None
        return SIGMAS * self.stddev


@dataclass(frozen=True)
class Section:
    """All entries of one message."""

    title: str
    """Heading of the names: ``element``, ``pulley``."""
    lines: tuple[Line, ...]


@dataclass(frozen=True)
class View:
    """Content of the live table at one time."""

    topic: str
    sections: tuple[Section, ...] = ()
    robot: str = ""
    """Name of the robot; empty while unknown."""
    rate_hz: float | None = None
    """Message rate [Hz]; None while unknown."""
    age_s: float | None = None
    """Time since the stamp of the latest message [s]; None before the first message."""
    notes: tuple[str, ...] = ()
    """Problems, such as a missing publisher, one sentence each."""


def status_words(status: int) -> tuple[tuple[str, str], ...]:
    """Words and styles of a status, most severe first; INVALID hides all other flags."""
    if status == OK:
        return (FINE,)
    if status & INVALID:
        return (STATUS[0][1:],)
    known = tuple((word, style) for flag, word, style in STATUS if status & flag)
    return known or ((f"FLAG {status}", "yellow"),)


def status_counts(lines: Iterable[Line]) -> dict[str, list[str]]:
    """Names of the entries by status word, in the order of ``STATUS``, with OK last."""
    found: dict[str, list[str]] = {word: [] for _, word, _ in STATUS}
    found[FINE[0]] = []
    for line in lines:
        for word, _ in status_words(line.status):
            found.setdefault(word, []).append(line.name)
    return {word: names for word, names in found.items() if names}


def live_table(view: View, width: int, rows: int | None = None, plain: bool = False) -> Group:
    """The table of all sections with header, summaries and notes.

    Args:
        view: what to show.
        width: columns of the terminal.
        rows: lines of the terminal; entries that do not fit are counted instead.  None shows all.
        plain: whether to use ASCII characters only.
    """
    parts: list[RenderableType] = [_header(view, plain)]
    room = _rooms(view, width, rows)
    for section, shown in zip(view.sections, room, strict=True):
        if not section.lines:
            continue
        parts.append(_table(section, shown, width, plain))
        if left := len(section.lines) - shown:
            parts.append(Text(f"... and {left} more; choose with --only PATTERN", style="dim"))
        parts.append(_summary(section))
    parts += [Text(printable(note), style="yellow") for note in view.notes]
    return Group(*parts)


def plain_line(view: View) -> str:
    """Summary of the view in one line without colours, for a pipe or a log."""
    facts = [fact for fact, _ in _facts(view)]
    for section in view.sections:
        valid = [line for line in section.lines if line.valid]
        if valid:
            largest = max(valid, key=lambda line: line.value)
            spread = "" if largest.spread is None else f" +-{largest.spread:.2f}"
            facts.append(f"largest {printable(largest.name)} {largest.value:.2f}{spread} N")
        if section.lines:
            counts = status_counts(section.lines)
            facts.append(" ".join(f"{len(names)} {word}" for word, names in counts.items()))
    return "; ".join([", ".join(facts), *(printable(note) for note in view.notes)]).strip("; ")


def _facts(view: View) -> Iterator[tuple[str, str]]:
    """Topic, robot, rate and age, each with its style."""
    yield printable(view.topic), "bold"
    if view.robot:
        yield printable(view.robot), "bold cyan"
    if view.rate_hz is not None:
        yield f"{view.rate_hz:.0f} Hz", ""
    if view.age_s is None:
        return
    if abs(view.age_s) > FOREIGN_S:
        yield "recorded stamps", "dim"
    else:
        yield f"age {view.age_s:.3f} s", "yellow" if abs(view.age_s) > SLOW_S else ""


def _header(view: View, plain: bool) -> Text:
    text = Text()
    for fact, style in _facts(view):
        if text:
            text.append(" - " if plain else " · ", style="dim")
        text.append(fact, style=style)
    return text


def _rooms(view: View, width: int, rows: int | None) -> list[int]:
    """Number of entries shown of each section; the available lines are shared evenly."""
    counts = [len(section.lines) for section in view.sections]
    if rows is None:
        return counts
    notes = sum(1 + len(note) // max(width, 1) for note in view.notes)
    fixed = 3 + notes + 5 * len(counts)  # headings, summaries and a line for omitted entries
    left = max(rows - fixed, len(counts))
    rooms = [0] * len(counts)
    for done, at in enumerate(sorted(range(len(counts)), key=counts.__getitem__)):
        rooms[at] = min(counts[at], left // (len(counts) - done))
        left -= rooms[at]
    return rooms


def _table(section: Section, shown: int, width: int, plain: bool) -> Table:
    narrow = width < NARROW
    scale = round_scale(max((_reach(line) for line in section.lines), default=0.0))
    limited = any(isfinite(line.limit) for line in section.lines)
    table = Table(box=box.ASCII2 if plain else box.SIMPLE_HEAD, expand=True, pad_edge=False)
    table.width = width

    def column(heading: str, justify: JustifyMethod, most: int | None, ratio: int = 0) -> None:
        table.add_column(
            Text(heading), justify=justify, no_wrap=justify == "right", overflow="ellipsis",
            max_width=most, ratio=ratio or None,
        )  # fmt: skip

    column(section.title, "left", 16 if narrow else 40)
    column("N", "right", None)
    column("+-2s" if plain else "±2σ", "right", None)
    column("0 ... limit" if limited else f"0 ... {scale:.4g} N", "left", None, ratio=1)
    column("status", "left", 12 if narrow else 24)
    for line in section.lines[:shown]:
        words = status_words(line.status)
        spread = "" if line.spread is None else f"{line.spread:.2f}"
        table.add_row(
            Text(printable(line.name)),
            Text(f"{line.value:.2f}" if line.valid else "-"),
            Text(spread if line.valid else "", style="dim"),
            _Bar(line, line.limit if isfinite(line.limit) else scale, words[0][1], plain),
            Text(" ").join(Text(word, style=style) for word, style in words),
        )
    return table


def round_scale(largest: float) -> float:
    """Round up to one of a few scales, so that the scale of the bars changes rarely."""
    if not largest > 0.0:
        return 1.0
    power = 10.0 ** floor(log10(largest))
    return next(power * step for step in SCALES if power * step >= largest)


def _reach(line: Line) -> float:
    """Upper end of the bar of an entry, including 2σ [N]."""
    return line.value + (line.spread or 0.0) if line.valid else 0.0


def _summary(section: Section) -> Text:
    """Number of entries by status, with the names of invalid, overloaded and slack ones."""
    styles = {word: style for _, word, style in STATUS} | {FINE[0]: FINE[1]}
    text = Text()
    for word, names in status_counts(section.lines).items():
        if text:
            text.append(", ")
        text.append(f"{len(names)} {word}", style=styles.get(word, "yellow"))
        if word in ("INVALID", "OVERLOAD", "SLACK"):
            text.append(f" ({_few(names)})", style="dim")
    return text


def _few(names: Sequence[str], most: int = 4) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(printable(name) for name in names[:most]) + more


class _Bar:
    """A bar as wide as its column: solid up to value - 2σ, shaded up to value + 2σ."""

    def __init__(self, line: Line, scale: float, style: str, plain: bool) -> None:
        self._line, self._scale, self._style = line, scale, style
        self._full, self._shaded, self._beyond = "#->" if plain else "█▒▶"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield Segment(self.text(options.max_width), Style.parse(self._style))

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        return Measurement(4, options.max_width)

    def text(self, width: int) -> str:
        """The bar in ``width`` columns, with an arrow at its end if it exceeds the scale."""
        line = self._line
        if not line.valid or not self._scale > 0.0:
            return " " * width
        spread = line.spread or 0.0
        low, high = (
            min(max(round(width * value / self._scale), 0), width)
            for value in (line.value - spread, line.value + spread)
        )
        text = self._full * low + self._shaded * (high - low)
        if line.value + spread > self._scale * (1.0 + 1e-9):
            text = text[:-1] + self._beyond
        return text.ljust(width)
