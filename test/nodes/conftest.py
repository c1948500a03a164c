"""A ROS context for the test, and the installed executables as processes beside it."""

from __future__ import annotations

import contextlib
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Protocol

import pytest

PATIENCE_S = 10.0


class StartNode(Protocol):
    """Start an installed executable; it ends with the test, as by Ctrl-C."""

    def __call__(
        self,
        name: str,
        *arguments: str,
        stdout: int | IO[bytes] | None = None,
        stderr: int | IO[bytes] | None = None,
    ) -> subprocess.Popen[bytes]: ...


@pytest.fixture(scope="session")
def executables() -> Path:
    """The folder of the executables that `ros2 run cdrj_ros` would start."""
    from ament_index_python.packages import get_package_prefix

    return Path(get_package_prefix("cdrj_ros"), "lib", "cdrj_ros")


@pytest.fixture
def ros() -> Iterator[None]:
    """Initialise rclpy's default context for the test and shut it down after it."""
    import rclpy

    rclpy.init()
    try:
        yield
    finally:
        rclpy.try_shutdown()


@pytest.fixture
def node(ros: None) -> Iterator[object]:
    """The test's own rclpy node."""
    from rclpy.node import Node

    node = Node("test")
    try:
        yield node
    finally:
        node.destroy_node()


@pytest.fixture
def start_node(executables: Path) -> Iterator[StartNode]:
    """Start installed executables as processes; whatever still runs is ended after the test."""
    started: list[subprocess.Popen[bytes]] = []

    def start(
        name: str,
        *arguments: str,
        stdout: int | IO[bytes] | None = None,
        stderr: int | IO[bytes] | None = None,
    ) -> subprocess.Popen[bytes]:
        process = subprocess.Popen([executables / name, *arguments], stdout=stdout, stderr=stderr)
        started.append(process)
        return process

    yield start
    for process in reversed(started):
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE_S)
        if process.poll() is None:
            process.kill()
            process.wait()


@pytest.fixture
def wait_until() -> Callable[[Callable[[], bool], float], bool]:
    """Wait for a condition, at most so many seconds: discovery takes what it takes."""
    import time

    def wait(condition: Callable[[], bool], timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.01)
        return True

    return wait
