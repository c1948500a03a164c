"""Estimators in separate processes over DDS: killed, restarted, and with load cells."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cdrj_msgs.srv import SetPreload
from std_srvs.srv import Trigger
from support.remote import ROBOT, Remote

from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Sample, Samples
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model

MOTOR = Template(JOINT_STATE, ("winch",), ("position",))
JOINT = Template(JOINT_STATE, ("elbow",), ("position",))
CELLS = ("upper/8", "lower/8")
RAW = {"tracking_bandwidth": 0.0}
"""No filter between counts, since the tests compare with run()."""
CELL = Template(CABLE_TENSIONS, CELLS, ("tension", "stddev"))


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(ROBOT)


@pytest.fixture(scope="module")
def readings(model: Model, recorded: Callable[[Model, int], Samples]) -> Samples:
    """Recorded angles of six cycles, at 250 Hz."""
    return recorded(model, 6)


def send(remote: Remote, readings: Samples, first: int, last: int, cells: Any = None) -> None:
    """Send readings, with load cell tensions at every fourth; wait for the estimates."""
    begin = len(remote.answers)
    few = 100 if cells is None else 10  # a load cell's reading is valid for 0.2 s
    for k in range(first, last):
        stamp = int(readings.stamp_ns[k])
        if cells is not None and k % 4 == 0:
            noise = np.full(len(CELLS), 0.05)
            remote.cells.publish(CELL.encode(stamp, tension=cells[k], stddev=noise))
        joint = JOINT.encode(stamp, position=readings.joint_angle[k])
        remote.inputs["joint_states"].publish(joint)
        motor = MOTOR.encode(stamp, position=readings.motor_angle[k])
        remote.inputs["motor_states"].publish(motor)
        if k % few == few - 1:
            remote.until(lambda: len(remote.answers) > begin + k - first - 2 * few)  # noqa: B023
    assert remote.until(lambda: len(remote.answers) == begin + last - first)


def figures(words: str) -> None:
    """Print figures for docs/reliability.md."""
    print(words)  # noqa: T201


def alone(model: Model, readings: Samples) -> np.ndarray:
    """Tensions of an uninterrupted estimator [N]."""
    _, estimates = run(model, initial_state(model), readings)
    return estimates.values[:, model.layout.tension]


def test_of_two_estimators_one_is_killed_and_continues_and_the_other_is_not_affected(
    brisk_node: Any, model: Model, readings: Samples, start_node: Any, tmp_path: Path
) -> None:
    """Each estimator is a process; one is killed in motion and restarts from its state file."""
    state_file = tmp_path / "state"
    left, right = (Remote(brisk_node, start_node, side) for side in ("left", "right"))
    left.start("--state-file", str(state_file), **RAW)
    right.start(**RAW)
    send(left, readings, 0, 800)
    send(right, readings, 0, 800)
    written = state_file.stat().st_mtime_ns if state_file.exists() else 0
    assert left.until(lambda: state_file.exists() and state_file.stat().st_mtime_ns > written)

    left.kill()
    send(right, readings, 800, 1000)
    left.start("--state-file", str(state_file), **RAW)
    send(left, readings, 805, 1000)

    assert right.process.poll() is None
    truth = alone(model, readings)
    assert np.array_equal(right.heard()[0], truth[:1000])
    tension, stddev = left.heard()
    apart = np.abs(tension - truth[805:1000]) / stddev
    figures(f"first within {np.max(apart[0]):.2f} sigma, {np.mean(apart < 2.0):.1%} within two")
    assert np.max(apart[0]) < 2.0
    assert np.mean(apart < 2.0) > 0.95


def test_values_set_by_services_survive_a_kill(
    brisk_node: Any, model: Model, readings: Samples, start_node: Any, tmp_path: Path
) -> None:
    """The process is killed right after the response, before any further sample."""
    k = np.minimum(np.arange(readings.stamp_ns.size), 400)
    still = Samples(readings.stamp_ns, readings.motor_angle[k], readings.joint_angle[k])
    one = Remote(brisk_node, start_node, "set")
    arguments = ("--state-file", str(tmp_path / "state"))
    one.start(*arguments, **RAW)
    send(one, still, 0, 800)
    assert one.call(Trigger, "tare", Trigger.Request()).success
    request = SetPreload.Request(cable=["lower"], preload=[20.0])
    assert one.call(SetPreload, "set_preload", request).success
    one.kill()
    one.start(*arguments, **RAW)
    send(one, still, 799, 900)
    tension, _ = one.heard()
    assert np.allclose(tension[0, :8], 36.85)
    assert np.allclose(tension[0, 8:], 20.0)
    live = LiveEstimator(model)
    live.set_tracking(0.0)
    for n in range(700, 800):
        live.take(sample_of(still, n))
    live.tare()
    live.set_preload({"lower": 20.0})
    expected = [live.take(sample_of(still, k)).tension for k in range(799, 900)]
    assert np.array_equal(tension, expected)


def sample_of(readings: Samples, k: int) -> Sample:
    return Sample(int(readings.stamp_ns[k]), readings.motor_angle[k], readings.joint_angle[k])
