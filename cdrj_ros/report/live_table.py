"""Tensions as a live table in a terminal, or as one line of text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import Final

from rich import box
from rich.bar import Bar
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cdrj_ros.foundation.output import printable
from cdrj_ros.model.packing import INVALID, OK, OVERLOAD, SLACK, STALE, UNSURE

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

SIGMAS: Final = 2.0
"""Half width of the displayed interval [standard deviations]."""

SLOW_S: Final = 0.1
"""Age above which a message is drawn in a warning colour [s]."""

SCALES: Final = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0)
"""Full scales of a bar, times a power of ten."""

FEW: Final = 4
"""Names of invalid, overloaded or slack entries in the summary."""

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


def severity(status: int) -> int:
    """Place of the most severe flag in ``STATUS``, beyond the last one where there is none."""
    return next((k for k, (flag, *_) in enumerate(STATUS) if status & flag), len(STATUS))


def status_counts(lines: Iterable[Line]) -> dict[str, list[str]]:
    """Names of the entries by status word, in the order of ``STATUS``, with OK last."""
    found: dict[str, list[str]] = {word: [] for _, word, _ in STATUS}
    found[FINE[0]] = []
    for line in lines:
        for word, _ in status_words(line.status):
            found.setdefault(word, []).append(line.name)
    return {word: names for word, names in found.items() if names}


def live_table(view: View) -> Group:
    """The state in one line, then summary and table of all sections."""
    parts: list[RenderableType] = [
        Text(" · ").join(Text(fact, style=style) for fact, style in _facts(view))
    ]
    parts += [Text(printable(note), style="yellow") for note in view.notes]
    for section in view.sections:
        if section.lines:
            parts += [_summary(section), _table(section)]
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


def _table(section: Section) -> Table:
    scale = round_scale(max((one.value for one in section.lines if one.valid), default=0.0))
    table = Table(box=box.SIMPLE_HEAD, expand=True, pad_edge=False)
    table.add_column(Text(section.title), overflow="ellipsis", max_width=40)
    table.add_column("N", justify="right", no_wrap=True)
    table.add_column("±2σ", justify="right", no_wrap=True, style="dim")
    table.add_column(f"0 ... {scale:.4g} N", ratio=1)
    table.add_column("status", max_width=24)
    for line in section.lines:
        words = status_words(line.status)
        value = max(line.value, 0.0) if line.valid else 0.0
        table.add_row(
            Text(printable(line.name)),
            Text(f"{line.value:.2f}" if line.valid else "-"),
            Text(f"{line.spread:.2f}" if line.valid and line.spread is not None else ""),
            Bar(scale, 0.0, value, color=words[0][1].split()[-1]),
            Text(" ").join(Text(word, style=style) for word, style in words),
        )
    return table


def round_scale(largest: float) -> float:
    """Round up to one of a few scales, so that the scale of the bars changes rarely."""
    if not largest > 0.0:
        return 1.0
    power = 10.0 ** floor(log10(largest))
    return next(power * step for step in SCALES if power * step >= largest)


def _summary(section: Section) -> Text:
    """Number of entries by status, with the names of invalid, overloaded and slack ones."""
    styles = {word: style for _, word, style in STATUS} | {FINE[0]: FINE[1]}
    text = Text()
    for word, names in status_counts(section.lines).items():
        if text:
            text.append(", ")
        text.append(f"{len(names)} {word}", style=styles.get(word, "yellow"))
        if word in ("INVALID", "OVERLOAD", "SLACK"):
            more = f" and {len(names) - FEW} more" if len(names) > FEW else ""
            text.append(f" ({', '.join(map(printable, names[:FEW]))}{more})", style="dim")
    return text
