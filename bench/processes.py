"""Start nodes as separate processes and end them by process id."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

from bench.figures import ROBOT

PATIENCE_S = 60.0
Process = subprocess.Popen[bytes]


def isolate() -> None:
    """Give this process and its children a ROS domain of their own on this machine."""
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def estimator_command(log_level: str = "warn") -> list[str]:
    """Command line of the installed estimator; its timeout is long, so it never turns stale."""
    from ament_index_python.packages import get_package_prefix

    executable = Path(get_package_prefix("cdrj_ros"), "lib", "cdrj_ros", "estimator")
    return [
        str(executable), "--ros-args", "--log-level", log_level,
        "-p", f"robot:={ROBOT}", "-p", "timeout:=3600.0",
    ]  # fmt: skip


def node_command(*arguments: object) -> list[str]:
    """Command line of one of the bare nodes."""
    return [sys.executable, str(Path(__file__).with_name("node.py")), *map(str, arguments)]


def end(process: Process) -> None:
    """Interrupt a node with SIGINT; kill it only if it does not end."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextmanager
def running(*command: str) -> Iterator[Process]:
    """Run a process while the body runs."""
    process = subprocess.Popen(command)
    try:
        yield process
    finally:
        end(process)


@contextmanager
def listening(name: str) -> Iterator[tuple[Any, Any]]:
    """Create a node in this process and the executor that spins it."""
    import rclpy
    from rclpy.experimental import EventsExecutor
    from rclpy.node import Node

    rclpy.init(args=[])
    node = Node(name)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def spin_until(
    executor: Any, condition: Callable[[], bool], process: Process, poll_s: float = 0.002
) -> None:
    """Spin until a condition holds.

    Raises:
        RuntimeError: it does not hold within ``PATIENCE_S``, or the process has ended.
    """
    deadline = monotonic() + PATIENCE_S
    while not condition():
        executor.spin_once(timeout_sec=poll_s)
        if process.poll() is not None:
            raise RuntimeError(f"a node ended early, exit code {process.returncode}")
        if monotonic() > deadline:
            raise RuntimeError(f"a node did not answer within {PATIENCE_S:g} s")
