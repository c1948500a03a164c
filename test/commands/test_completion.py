"""Options of the commands are completed by the shell where argcomplete is installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("validate --ht", {"--html"}),
        ("identify --s", {"--scheduler", "--settings", "--start"}),
        ("check_robot --js", {"--json"}),
    ],
)
def test_options_are_completed(line: str, expected: set[str], tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    command, said = line.split(maxsplit=1)[0], tmp_path / "said"
    asked = {
        "_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(said), "COMP_LINE": line,
        "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": " ",
    }  # fmt: skip
    module = f"cdrj_ros.commands.{command}"
    run = f"import sys; sys.argv[0] = {command!r}; from {module} import main; sys.exit(main())"
    subprocess.run([sys.executable, "-c", run], env=os.environ | asked, check=True)
    assert {word.strip() for word in said.read_text().split()} == expected
