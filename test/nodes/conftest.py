"""Fixtures: a ROS context for the test, and the installed executables as processes."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
import pytest
from support.estimators import Bench
from support.forked import Forked, end

from cdrj_ros.recordings import BagWriter, Topics, read_recording

PATIENCE_S = 60.0
SAMPLE = Path(__file__).parents[2] / "bags" / "prototype_preload_36_26"


class StartExecutable(Protocol):
    """Start an installed executable; it is interrupted after the test as by Ctrl-C."""

    def __call__(
        self,
        name: str,
        *arguments: str,
        stdout: int | IO[bytes] | None = None,
        stderr: int | IO[bytes] | None = None,
    ) -> subprocess.Popen[bytes]: ...


StartNode = Callable[..., Forked]


@pytest.fixture(scope="session")
def executables() -> Path:
    """The folder of the executables that `ros2 run cdrj_ros` starts."""
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
def brisk_node(node: Any) -> Iterator[Any]:
    """The test's own node with a ``spin_once`` that is faster than rclpy's function."""
    from rclpy.experimental import EventsExecutor

    executor = EventsExecutor()
    executor.add_node(node)
    node.spin_once = executor.spin_once
    try:
        yield node
    finally:
        executor.shutdown()


@pytest.fixture
def bench(ros: None) -> Iterator[Bench]:
    """Estimators in this process and a node that communicates with them."""
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def start_executable(executables: Path) -> Iterator[StartExecutable]:
    """Start installed executables as processes; those still running are ended after the test."""
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
        end(process)


@pytest.fixture
def start_node() -> Iterator[StartNode]:
    """As ``start_executable``, for tests of a running node: forked, which saves its imports."""
    started: list[Forked] = []

    def start(name: str, *arguments: str) -> Forked:
        started.append(Forked(name, arguments, 2))
        return started[-1]

    yield start
    for process in reversed(started):
        end(process)


@pytest.fixture
def wait_until() -> Callable[[Callable[[], bool], float], bool]:
    """Wait for a condition for at most ``timeout_s``, since discovery takes a variable time."""
    import time

    def wait(condition: Callable[[], bool], timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(0.01)
        return True

    return wait


def _beginning(path: Path, seconds: int, ends: tuple[str, ...]) -> str:
    """The inputs of the sample recording, with tensions of the elements that end so."""
    whole = read_recording(SAMPLE)
    until = whole.start_ns + seconds * 1_000_000_000
    with BagWriter(path) as bag:
        for topic, channels in (
            (Topics().motors, whole.motors),
            (Topics().joints, whole.joints),
        ):
            for name, series in channels.items():
                kept = series.stamp_ns < until
                bag.write_joint_states(
                    topic, series.stamp_ns[kept], (name,), position=series.value[kept, None]
                )
        tensions = {
            name.removeprefix("tension/"): series
            for name, series in whole.references.items()
            if name.startswith("tension/") and name.endswith(ends)
        }
        stamps = next(iter(tensions.values())).stamp_ns
        kept = stamps < until
        values = np.stack([series.value[kept] for series in tensions.values()], axis=1)
        bag.write_tensions(Topics().references[0], stamps[kept], list(tensions), values)
    return str(path)


@pytest.fixture(scope="session")
def short_bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The first four seconds of the sample recording, with tensions as references.

    Drawing those of all elements would take longer than playing them.
    """
    return _beginning(tmp_path_factory.mktemp("bags") / "short", 4, ("/1", "/8"))


@pytest.fixture(scope="session")
def longer_bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """As ``short_bag``, of 20 s, to be played for a while."""
    return _beginning(tmp_path_factory.mktemp("bags") / "longer", 20, ("/1", "/8"))
