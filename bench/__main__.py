"""Measure the estimator's speed against its peers and print one table of ratios."""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from bench.figures import ROOT, Row
from bench.page import renewed, versions, written
from bench.processes import isolate
from cdrj_ros.foundation.files import write_text

PAGE = ROOT / "docs" / "speed.md"
FIGURES = ROOT / "docs" / "speed.json"


class Section(NamedTuple):
    """A part of the benchmark, measured in a process of its own."""

    module: str
    said: str
    """Text of its progress line."""
    limit_s: float
    """Time after which the section is given up [s]."""


SECTIONS = {
    "step": Section("update", "one update beside MuJoCo's and Exudyn's evaluation", 30.0),
    "opensim": Section("cable_spans", "one update beside OpenSim's evaluation", 30.0),
    "space": Section("space", "cables given by positions", 30.0),
    "node": Section("roundtrip", "the node's round trip beside a bare relay's", 45.0),
    "rate": Section("sustained", "the highest rate without a loss", 60.0),
    "offline": Section("offline", "a 200 s bag beside rosbags", 100.0),
    "many": Section("campaign", "many bags on all cores beside one, and a fit", 150.0),
    "pulleys": Section("scaling", "cost per pulley from 7 to 10 000", 45.0),
    "hand": Section("hand", "a hand beside its fingers", 150.0),
    "start": Section("start", "the estimator's start beside a bare node's", 45.0),
    "demo": Section("demonstration", "make demo from nothing, packages installed", 400.0),
    "tests": Section("suite", "make test", 1200.0),
}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument(
        "--json", metavar="FILE", type=Path,
        help="write the figures as JSON (default docs/speed.json if all sections are measured)",
    )  # fmt: skip
    parser.add_argument(
        "--only", metavar="NAME,...",
        help=f"sections to measure, of {','.join(SECTIONS)}; docs/speed.md is then left alone",
    )  # fmt: skip
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    arguments.whole = arguments.only is None
    arguments.only = arguments.only.split(",") if arguments.only else list(SECTIONS)
    if unknown := [name for name in arguments.only if name not in SECTIONS]:
        parser.error(f"--only takes {', '.join(SECTIONS)}; got {', '.join(unknown)}")
    if arguments.whole and arguments.json is None:
        arguments.json = FIGURES
    return arguments


def _alone(name: str) -> list[Row]:
    """Measure a section in a process group of its own, which is killed afterwards.

    Raises:
        RuntimeError: it failed, or took longer than its limit.
    """
    limit_s = SECTIONS[name].limit_s
    with TemporaryDirectory() as folder:
        figures = Path(folder, "figures.json")
        command = [sys.executable, "-m", "bench", "--child", "--only", name, "--json", str(figures)]
        process = subprocess.Popen(
            command, cwd=ROOT, start_new_session=True, stderr=subprocess.PIPE, text=True
        )
        try:
            _, said = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"not finished within {limit_s:g} s") from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        if process.returncode != 0:
            last = said.strip().splitlines()[-1:] or ["no message"]
            raise RuntimeError(f"exit code {process.returncode}: {last[0]}")
        found = json.loads(figures.read_text(encoding="utf-8"))
    return [Row.from_json(row) for row in found["rows"]]


def machine() -> str:
    """Processor, cores, kernel and Python version of this machine."""
    model = platform.machine()
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    cores = len(os.sched_getaffinity(0))
    return f"{model}, {cores} cores, Linux {platform.release()}, Python {platform.python_version()}"


def load() -> str:
    """Load average of the machine before the benchmark starts its own processes."""
    return f"load average {os.getloadavg()[0]:.1f} at the start"


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


def _save(path: Path, rows: Sequence[Row], failed: Sequence[str], where: str) -> None:
    figures = {
        "machine": where, "versions": versions(),
        "rows": [row.as_json() for row in rows], "failed": list(failed),
    }  # fmt: skip
    write_text(path, json.dumps(figures, indent=1, ensure_ascii=False) + "\n")


def main() -> int:
    """Run the sections; the exit code is 1 if one failed and does not depend on speed."""
    arguments = _arguments()
    isolate()
    if arguments.child:
        module = import_module(f"bench.{SECTIONS[arguments.only[0]].module}")
        _save(arguments.json, module.measure(), (), machine())
        return 0
    where = f"{machine()}, {load()}"
    console = Console(width=None if sys.stdout.isatty() else 180)
    rows: list[Row] = []
    failed: list[str] = []
    for name in arguments.only:
        console.print(f"{name}: {SECTIONS[name].said} ...", end="", highlight=False)
        begin = perf_counter()
        try:
            rows += _alone(name)
        except RuntimeError as error:
            failed.append(f"{SECTIONS[name].said}: {error}")
            console.print(f" {error}", end="", highlight=False, markup=False)
        console.print(f" {perf_counter() - begin:.0f} s", highlight=False)
    console.print(table_of(rows))
    if arguments.json:
        _save(arguments.json, rows, failed, where)
        console.print(f"figures: {arguments.json}")
    if arguments.whole:
        page = PAGE.read_text(encoding="utf-8")
        write_text(PAGE, renewed(page, written(rows, where, versions(), failed)))
        console.print(f"page: {PAGE}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
