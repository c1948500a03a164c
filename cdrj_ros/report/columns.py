"""Tables of text: with rules in a wide terminal, otherwise as plain columns."""

from __future__ import annotations

import sys
from io import StringIO
from typing import TYPE_CHECKING, Final, TextIO

from cdrj_ros.foundation.text import printable

if TYPE_CHECKING:
    from rich.table import Table


UNLIMITED: Final = 100_000
"""Width at which no table is wrapped [characters]."""


def new_table(title: str = "") -> Table:
    """An empty table."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    heading = Text(printable(title)) if title else None
    return Table(title=heading, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)


def print_table(table: Table, file: TextIO | None) -> None:
    """Print a table with rules if the terminal is wide enough, otherwise as plain columns."""
    from rich.console import Console

    stream = sys.stdout if file is None else file
    if stream.isatty():
        console = Console(file=stream)
        room = console.options.update(max_width=UNLIMITED)
        if console.measure(table, options=room).maximum <= console.width:
            console.print(table)
            return
    stream.write(plain(table))


def plain(table: Table) -> str:
    """A table as aligned columns of text without rules, of any width."""
    from rich.console import Console

    table.box, table.show_edge = None, False
    console = Console(file=StringIO(), width=UNLIMITED, color_system=None, force_terminal=False)
    with console.capture() as captured:
        console.print(table)
    return "".join(f"{line.rstrip()}\n" for line in captured.get().splitlines())
