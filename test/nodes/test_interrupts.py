"""Ctrl-C ends every installed executable at any moment: one line, exit code 130, no traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
ROBOT = str(ROOT / "config" / "robots" / "prototype.yaml")
BAG = str(ROOT / "bags" / "prototype_preload_36_26")
PATIENCE_S = 30.0
"""Timeout on a machine under load [s]; waiting for a thread pool would take 55 s."""

LATEST_S = 1.5
"""Latest random interrupt after the installation of the handler, during imports or work [s]."""

COMMANDS = {
    "check_robot": ["prototype"],
    "validate": [BAG, "--robot", ROBOT],
    "identify": [BAG, "--robot", ROBOT, "--fit", "rho", "--out", "{tmp}/robot.yaml"],
    "simulate": ["--robot", ROBOT, "--duration", "100", "{tmp}/bag"],
    "reproduce": ["--out", "{tmp}/figures"],
    "estimator": ["--ros-args", "-p", f"robot:={ROBOT}"],
    "replay": [BAG, "--robot", ROBOT],
}

Start = Callable[[str], subprocess.Popen[bytes]]


def threads(process: subprocess.Popen[bytes]) -> int:
    """Number of threads of a running process; the second thread waits for interrupts."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    (line,) = (line for line in status.splitlines() if line.startswith("Threads:"))
    return int(line.split()[1])


@pytest.fixture
def start(executables: Path, tmp_path: Path) -> Iterator[Start]:
    """Start a command of ``COMMANDS`` and wait until it handles signals."""
    started: list[subprocess.Popen[bytes]] = []

    def one(name: str) -> subprocess.Popen[bytes]:
        arguments = [argument.format(tmp=tmp_path) for argument in COMMANDS[name]]
        process = subprocess.Popen(
            [executables / name, *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        started.append(process)
        deadline = time.monotonic() + PATIENCE_S
        while threads(process) < 2:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.001)
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
        assert interrupted(start(name)) == (130, f"{name}: interrupted\n")


def test_an_interrupt_at_a_random_moment_is_one_line_and_code_130(start: Start) -> None:
    rng = np.random.default_rng(7)
    for name in COMMANDS:
        process = start(name)
        try:
            process.wait(rng.uniform(0.3, LATEST_S))
        except subprocess.TimeoutExpired:
            code, errors = interrupted(process)
        else:  # a fast machine
            code, errors = process.returncode, process.communicate()[1].decode()
        assert "Traceback" not in errors, name
        assert "Exception ignored" not in errors, name
        if code == 130:
            assert errors.count(f"{name}: interrupted\n") == 1
        else:
            assert code == 0, (name, errors)
            assert name in ("check_robot", "estimator")


def test_an_interrupt_does_not_wait_for_threads(start: Start, wait_until: Any) -> None:
    """``reproduce`` runs the rig in a pool of threads, whose kernels cannot be interrupted."""
    process = start("reproduce")
    wait_until(lambda: threads(process) > 2, PATIENCE_S)  # besides the main and the signal thread
    code, errors = interrupted(process)
    assert (code, errors.count("reproduce: interrupted\n")) == (130, 1)
