"""The source's figures 8, 9, 12, 13 and 14 redrawn, with its tables.

    python3 -m examples.paper --out DIR

in the folder that holds ``examples/``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic
from typing import Final

from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_new, check_outputs, write_text
from cdrj_ros.foundation.interruption import run_interruptibly
from cdrj_ros.foundation.output import ProgressBar, say
from cdrj_ros.model.prepared import load_model
from examples.paper.runs import Motion
from examples.paper.study import Study, numbers, work
from examples.paper.tables import markdown, tables

DESCRIPTION: Final = (
    "Redraw the source's figures 8, 9, 12, 13 and 14; print its tables with those computed here."
)

WHOLE: Final = (Motion(), 8)
"""Motion, and contact cells per pulley of the rig."""

QUICK: Final = (Motion(cycles=1, rate=250.0), 2)
"""The same with ``--quick``."""

OUTPUTS: Final = ("tables.md", "figures.json", "fig*.png", "fig*.pdf")
"""Files that a run writes."""


def parser() -> argparse.ArgumentParser:
    """Options of the command."""
    options = CommandParser(prog="paper", description=DESCRIPTION)
    options.add_argument(
        "--out", required=True, metavar="DIR",
        help="folder for the figures (PNG and PDF), tables.md and figures.json; it is created if "
        "missing",
    )  # fmt: skip
    options.add_argument(
        "--force", action="store_true", help="replace the results of an earlier run in --out"
    )
    options.add_argument(
        "--quick", action="store_true",
        help=f"for a first look, with other numbers than the docs: {QUICK[0].cycles} cycle instead "
        f"of {WHOLE[0].cycles}, {QUICK[0].rate:g} steps per second instead of {WHOLE[0].rate:g}, "
        f"{QUICK[1]} contact cells per pulley instead of {WHOLE[1]}, PNG only",
    )  # fmt: skip
    return options


def _body(argv: Sequence[str]) -> int:
    arguments = parser().parse_args(argv)
    folder = _output_folder(Path(arguments.out), arguments.force)
    begin = monotonic()
    robot = load_model("prototype").robot
    motion, cells = QUICK if arguments.quick else WHOLE
    with ProgressBar("running the rig", 1.0) as report:
        study = work(robot, motion, cells=cells, progress=report)
    drawn = _draw(study, folder, quick=arguments.quick)
    text = markdown(tables(study))
    print(text)
    write_text(folder / "tables.md", text)
    figures = json.dumps(numbers(study), indent=1, allow_nan=False)
    write_text(folder / "figures.json", figures + "\n")
    for paths in drawn:
        others = "".join(f" (and {path.suffix})" for path in paths[1:])
        say(f"figure: {paths[0]}{others}")
    say(f"tables: {folder / 'tables.md'}")
    say(f"numbers: {folder / 'figures.json'}")
    print(f"done in {monotonic() - begin:.0f} s")
    return DONE


def _draw(study: Study, folder: Path, *, quick: bool) -> list[tuple[Path, ...]]:
    from examples.paper.figures import FIGURES, FORMATS, figure_files

    drawn = []
    with ProgressBar("drawing", float(FIGURES)) as report:
        for paths in figure_files(study, folder, ("png",) if quick else FORMATS):
            drawn.append(paths)
            report(float(len(drawn)))
    return drawn


def _output_folder(folder: Path, force: bool) -> Path:
    """The folder, created before the long work.

    Raises:
        UsageError: it cannot be created or written to, or holds results and ``force`` is not set.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out must be a folder, {folder} is a file")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {folder} cannot be created: {error.strerror}") from error
    check_outputs({"--out": folder / "tables.md"})
    for pattern in OUTPUTS:
        for path in sorted(folder.glob(pattern)):
            check_new({"--out": path}, force=force)
    return folder


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    return run_command("paper", _body, argv)


def _loaded() -> Callable[[], int]:
    return main


if __name__ == "__main__":
    run_interruptibly("paper", _loaded)
