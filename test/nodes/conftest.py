"""Fixtures: a ROS context for the test, and the installed executables as processes."""

import gc
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest
from support.estimators import Bench
from support.processes import end

from cdrj_ros.commands import simulate

collect_ignore_glob = [] if find_spec("rclpy") else ["test_*.py"]
PATIENCE_S = 60.0


@pytest.fixture(scope="session")
def executables():
    """The folder of the executables that `ros2 run cdrj_ros` starts."""
    from ament_index_python.packages import get_package_prefix

    return Path(get_package_prefix("cdrj_ros"), "lib", "cdrj_ros")


@pytest.fixture
def ros():
    """Initialise rclpy's default context for the test and shut it down after it.

    A destroyed node keeps its participant, which other nodes see, until it is garbage.
    """
    import rclpy

    rclpy.init()
    try:
        yield
    finally:
        rclpy.try_shutdown()
        gc.collect()


@pytest.fixture
def node(ros):
    """The test's own rclpy node."""
    from rclpy.node import Node

    node = Node("test")
    try:
        yield node
    finally:
        node.destroy_node()


@pytest.fixture
def bench(ros):
    """Estimators in this process and a node that communicates with them."""
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def start_executable(executables):
    """Start installed executables as processes; those still running are ended as by Ctrl-C."""
    started = []

    def start(name, *arguments, **streams):
        started.append(subprocess.Popen([executables / name, *arguments], **streams))
        return started[-1]

    yield start
    for process in reversed(started):
        end(process)


def _simulated(folder, seconds):
    path = str(folder / "bag")
    assert simulate.main([path, "--robot", "prototype", "--duration", seconds, "--cells", "1"]) == 0
    return path


@pytest.fixture(scope="session")
def short_bag(tmp_path_factory):
    """Four seconds of the rig, with references."""
    return _simulated(tmp_path_factory.mktemp("short"), "4")


@pytest.fixture(scope="session")
def longer_bag(tmp_path_factory):
    """As ``short_bag``, of 20 s, to be played for a while."""
    return _simulated(tmp_path_factory.mktemp("longer"), "20")
