"""The source's figures 8, 9, 12, 13 and 14 redrawn, with its tables.

    python3 -m examples.paper --out DIR

in the folder that holds ``examples/``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from cdrj_ros.commands.entry import DONE, CommandParser, run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.files import check_outputs, write_text
from cdrj_ros.foundation.interruption import run_interruptibly
from cdrj_ros.foundation.output import ProgressBar, say
from cdrj_ros.model.prepared import load_model
from examples.paper.runs import Motion
from examples.paper.study import work
from examples.paper.tables import markdown, tables

WHOLE: Final = (Motion(), 8)
"""Motion, and contact cells per pulley of the rig."""

QUICK: Final = (Motion(cycles=1, rate=250.0), 2)
"""The same with ``--quick``."""

DESCRIPTION: Final = (
    "Redraw the source's figures 8, 9, 12, 13 and 14; print its tables with those computed here."
)


def _body(argv: Sequence[str]) -> int:
    parser = CommandParser(prog="paper", description=DESCRIPTION)
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of all results")
    parser.add_argument("--force", action="store_true", help="replace results in --out")
    parser.add_argument(
        "--quick", action="store_true",
        help="for a first look, with other numbers than the docs: one cycle, fewer steps and "
        "contact cells, PNG only",
    )  # fmt: skip
    arguments = parser.parse_args(argv)
    folder = _output_folder(Path(arguments.out), arguments.force)
    motion, cells = QUICK if arguments.quick else WHOLE
    with ProgressBar("running the rig", 1.0) as report:
        study = work(load_model("prototype").robot, motion, cells=cells, progress=report)
    text = markdown(tables(study))
    print(text)
    write_text(folder / "tables.md", text)

    from examples.paper.figures import figure_files  # slow to import, as it draws

    for path in figure_files(study, folder, ("png",) if arguments.quick else ("png", "pdf")):
        say(f"figure: {path}")
    say(f"tables: {folder / 'tables.md'}")
    return DONE


def _output_folder(folder: Path, force: bool) -> Path:
    """The folder, created before the long work.

    Raises:
        UsageError: it cannot be created or written to, or holds results and ``force`` is not set.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {folder} cannot be created: {error.strerror}") from error
    for path in (folder / "tables.md", *sorted(folder.glob("fig*.p*"))):
        check_outputs({"--out": path}, force=force)
    return folder


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    return run_command("paper", _body, argv)


def _loaded() -> Callable[[], int]:
    return main


if __name__ == "__main__":
    run_interruptibly("paper", _loaded)
