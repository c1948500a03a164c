"""Ctrl-C ends commands and nodes while they start: one line, exit code 130, no traceback."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest
from support.places import ROBOT, SAMPLE

PATIENCE_S = 30.0
"""Timeout on a machine under load [s]; waiting for a thread pool would take 55 s."""

PAUSE_S = 5e-4
"""Between two looks at a process that starts, which takes twenty times as long [s]."""

COMMANDS = {
    "validate": [str(SAMPLE), "--robot", ROBOT],
    "replay": [str(SAMPLE), "--robot", ROBOT],
    "estimator": ["--ros-args", "-p", f"robot:={ROBOT}"],
}


def loads(process):
    """Whether the command is being imported: Python itself and the script do not need NumPy."""
    return "/numpy/" in Path(f"/proc/{process.pid}/maps").read_text()


@pytest.mark.parametrize(("name", "supervised"), [*((n, False) for n in COMMANDS),
                                                  ("estimator", True)])  # fmt: skip
def test_an_interrupt_of_an_import_is_one_line_and_code_130_unless_the_node_is_supervised(
    name, supervised, start_executable
):
    process = start_executable(
        name, *COMMANDS[name], *(["--supervised"] if supervised else []),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    deadline = time.monotonic() + PATIENCE_S
    while not loads(process):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(PAUSE_S)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == (0 if supervised else 130)
    assert errors.decode() == f"{name}: interrupted\n"
