"""Ctrl-C ends every installed executable: one line, exit code 130, no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from support.places import ROBOT, SAMPLE

BAG = str(SAMPLE)
PATIENCE_S = 30.0
"""Timeout on a machine under load [s]; waiting for a thread pool would take 55 s."""


PAUSE_S = 5e-4
"""Between two looks at a process that starts, which takes twenty times as long [s]."""

COMMANDS = {
    "check_robot": ["prototype"],
    "validate": [BAG, "--robot", ROBOT],
    "identify": [BAG, "--robot", ROBOT, "--fit", "rho", "--out", "{tmp}/robot.yaml"],
    "simulate": ["--robot", ROBOT, "--duration", "100", "{tmp}/bag"],
    "estimator": ["--ros-args", "-p", f"robot:={ROBOT}"],
    "replay": [BAG, "--robot", ROBOT],
    "rig": ["--ros-args", "-p", f"robot:={ROBOT}"],
    "watch": [],
    "markers": ["--ros-args", "-p", f"robot:={ROBOT}"],
}


def loads(process: subprocess.Popen[bytes]) -> bool:
    """Whether the command is being imported: Python itself and the script do not need NumPy."""
    return "/numpy/" in Path(f"/proc/{process.pid}/maps").read_text()


def interrupted(start: Any, name: str, folder: Path, *options: str) -> tuple[int, str]:
    """Exit code and errors of a command of ``COMMANDS`` that is interrupted while it loads."""
    arguments = [argument.format(tmp=folder) for argument in COMMANDS[name]]
    process = start(
        name, *options, *arguments, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    deadline = time.monotonic() + PATIENCE_S
    while not loads(process):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(PAUSE_S)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE_S)
    return process.returncode, errors.decode()


@pytest.mark.parametrize("name", COMMANDS)
def test_an_interrupt_of_an_import_is_one_line_and_code_130(
    name: str, start_executable: Any, tmp_path: Path
) -> None:
    assert interrupted(start_executable, name, tmp_path) == (130, f"{name}: interrupted\n")


@pytest.mark.parametrize("name", ["estimator", "rig", "markers"])
def test_a_supervised_node_ends_with_code_0_also_while_it_is_imported(
    name: str, start_executable: Any, tmp_path: Path
) -> None:
    found = interrupted(start_executable, name, tmp_path, "--supervised")
    assert found == (0, f"{name}: interrupted\n")
