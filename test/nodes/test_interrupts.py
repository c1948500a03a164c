"""Ctrl-C ends every installed executable: one line, exit code 130, no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

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

Condition = Callable[[subprocess.Popen[bytes]], bool]
Start = Callable[..., subprocess.Popen[bytes]]


def loads(process: subprocess.Popen[bytes]) -> bool:
    """Whether the command is being imported: Python itself and the script do not need NumPy."""
    return "/numpy/" in Path(f"/proc/{process.pid}/maps").read_text()


@pytest.fixture
def start(executables: Path, tmp_path: Path) -> Iterator[Start]:
    """Start a command of ``COMMANDS`` with options and wait for a condition."""
    started: list[subprocess.Popen[bytes]] = []

    def one(name: str, until: Condition, *options: str) -> subprocess.Popen[bytes]:
        arguments = [argument.format(tmp=tmp_path) for argument in COMMANDS[name]]
        process = subprocess.Popen(
            [executables / name, *options, *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        started.append(process)
        deadline = time.monotonic() + PATIENCE_S
        while not until(process):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(PAUSE_S)
        return process

    yield one
    for process in started:
        if process.poll() is None:
            process.kill()
        process.wait()
        if process.stderr is not None:
            process.stderr.close()


def interrupted(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE_S)
    return process.returncode, errors.decode()


def test_an_interrupt_of_an_import_is_one_line_and_code_130(start: Start) -> None:
    for name in COMMANDS:
        assert interrupted(start(name, loads)) == (130, f"{name}: interrupted\n")


def test_a_supervised_node_ends_with_code_0_also_while_it_is_imported(start: Start) -> None:
    for name in ("estimator", "rig", "markers"):
        process = start(name, loads, "--supervised")
        assert interrupted(process) == (0, f"{name}: interrupted\n")
