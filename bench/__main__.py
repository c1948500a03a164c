"""Measure the estimator's speed against its peers and print one table of ratios."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from importlib import import_module
from pathlib import Path
from time import perf_counter

from rich.console import Console
from rich.table import Table

from bench.figures import Row
from bench.processes import isolate

SECTIONS = {
    "step": ("update", "one update beside MuJoCo's evaluation"),
    "offline": ("offline", "a 200 s bag beside rosbags"),
    "many": ("campaign", "many bags on all cores beside one, and a fit"),
    "node": ("roundtrip", "the node's round trip beside a bare relay's"),
    "pulleys": ("scaling", "cost per pulley from 7 to 10 000"),
    "start": ("start", "the estimator's start beside a bare node's"),
}
"""Per section: the module that measures it and the text of its progress line."""


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the figures as JSON")
    parser.add_argument(
        "--only", metavar="NAME,...", default=",".join(SECTIONS),
        help="sections to measure (default %(default)s)",
    )  # fmt: skip
    arguments = parser.parse_args()
    arguments.only = arguments.only.split(",")
    if unknown := [name for name in arguments.only if name not in SECTIONS]:
        parser.error(f"--only takes {', '.join(SECTIONS)}; got {', '.join(unknown)}")
    return arguments


def machine() -> str:
    """Processor, cores, kernel and Python version of this machine."""
    model = platform.machine()
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    cores = len(os.sched_getaffinity(0))
    return f"{model}, {cores} cores, Linux {platform.release()}, Python {platform.python_version()}"


def table_of(rows: list[Row]) -> Table:
    """Table of medians and quartiles, ours and the peer's."""
    table = Table(title=machine(), caption="median (quartiles); ratio: ours over theirs")
    for heading in ("what", "ours", "unit", "beside", "theirs", "ratio", "aim"):
        table.add_column(heading, justify="right" if heading in ("ours", "theirs") else "left")
    section = rows[0].section if rows else ""
    for row in rows:
        if row.section != section:
            table.add_section()
            section = row.section
        table.add_row(
            row.what,
            row.ours.text(),
            row.unit,
            row.beside,
            row.theirs.text() if row.theirs else "",
            row.ratio.text() if row.ratio else "",
            row.aim,
        )
    return table


def main() -> int:
    """Run the sections; the exit code does not depend on speed."""
    arguments = _arguments()
    isolate()
    console = Console(width=None if sys.stdout.isatty() else 180)
    rows: list[Row] = []
    for name in arguments.only:
        module, said = SECTIONS[name]
        console.print(f"{name}: {said} ...", end="", highlight=False)
        begin = perf_counter()
        rows += import_module(f"bench.{module}").measure()
        console.print(f" {perf_counter() - begin:.0f} s", highlight=False)
    console.print(table_of(rows))
    if arguments.json:
        figures = {"machine": machine(), "rows": [row.as_json() for row in rows]}
        arguments.json.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n")
        console.print(f"figures: {arguments.json}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
