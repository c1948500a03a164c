"""``reproduce``: the source's figures 8, 9, 12, 13 and 14 redrawn, its tables beside ours."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from time import monotonic
from typing import Final

from cdrj_ros.commands.shared import DONE, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.progress import progress_bar
from cdrj_ros.model.loading import load_model
from cdrj_ros.reproduction.runs import Motion
from cdrj_ros.reproduction.study import numbers, work
from cdrj_ros.reproduction.tables import Table, markdown, rich_table, tables

WHOLE: Final = (Motion(), 8)
"""Motion, and contact cells a pulley of the rig."""

QUICK: Final = (Motion(cycles=1), 2)
"""The same with ``--quick``."""

MINIMUM_WIDTH: Final = 150
"""Columns to which tables are printed where there is no terminal."""


def _body(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="reproduce", description=__doc__.split(": ", 1)[1])
    parser.add_argument(
        "--out", required=True, metavar="DIR",
        help="folder for figures (PNG and PDF), tables.md and figures.json; made where it is not",
    )  # fmt: skip
    parser.add_argument(
        "--quick", action="store_true",
        help=f"one cycle instead of {WHOLE[0].cycles}, {QUICK[1]} contact cells a pulley instead "
        f"of {WHOLE[1]}: a first look, not the numbers of the docs",
    )  # fmt: skip
    arguments = parser.parse_args(argv)
    folder = _made(Path(arguments.out))
    begin = monotonic()
    robot = load_model("prototype").robot
    motion, cells = QUICK if arguments.quick else WHOLE
    print("the first run compiles the kernels, up to a minute", file=sys.stderr, flush=True)
    with progress_bar("running the rig", 1.0) as report:
        study = work(robot, motion, cells=cells, progress=report)

    from cdrj_ros.reproduction.figures import FIGURES, figure_files

    with progress_bar("drawing", float(FIGURES)) as report:
        drawn = []
        for path in figure_files(study, folder):
            drawn.append(path)
            report(float(len(drawn)))
    all_tables = tables(study)
    (folder / "tables.md").write_text(markdown(all_tables), encoding="utf-8")
    (folder / "figures.json").write_text(
        json.dumps(numbers(study), indent=1, allow_nan=False) + "\n", encoding="utf-8"
    )
    _print(all_tables)
    for path in drawn:
        print(f"figure: {path} (and .pdf)")
    print(f"tables: {folder / 'tables.md'}")
    print(f"numbers: {folder / 'figures.json'}")
    print(f"done in {monotonic() - begin:.0f} s")
    return DONE


def _made(folder: Path) -> Path:
    """The folder, made now, so that nobody waits a minute for a refusal."""
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out must be a folder, {folder} is a file")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {folder} cannot be made: {error.strerror}") from error
    return folder


def _print(all_tables: Sequence[Table]) -> None:
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=MINIMUM_WIDTH)
    for table in all_tables:
        console.print(rich_table(table))


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return run_command("reproduce", _body, argv)
