"""Start nodes as separate processes and end them by process id."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

PATIENCE_S = 60.0
Process = subprocess.Popen[bytes]


def isolate() -> None:
    """Give this process and its children a ROS domain of their own on this machine."""
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def estimator_command(robot: Path) -> list[str]:
    """Command line of the installed estimator; its timeout is long, so it never turns stale."""
    from ament_index_python.packages import get_package_prefix

    executable = Path(get_package_prefix("cdrj_ros"), "lib", "cdrj_ros", "estimator")
    parameters = [f"robot:={robot}", "timeout:=3600.0"]
    options = [option for one in parameters for option in ("-p", one)]
    return [str(executable), "--ros-args", "--log-level", "warn", *options]


@contextmanager
def running(*command: str) -> Iterator[Process]:
    """Run a node while the body runs, then interrupt it; kill it only if it does not end."""
    process = subprocess.Popen(command)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


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


def spin_until(executor: Any, condition: Callable[[], bool], process: Process) -> None:
    """Spin until a condition holds.

    Raises:
        RuntimeError: it does not hold within ``PATIENCE_S``, or the process has ended.
    """
    deadline = monotonic() + PATIENCE_S
    while not condition():
        executor.spin_once(timeout_sec=0.002)
        if process.poll() is not None:
            raise RuntimeError(f"a node ended early, exit code {process.returncode}")
        if monotonic() > deadline:
            raise RuntimeError(f"a node did not answer within {PATIENCE_S:g} s")
