"""An estimator in a process of its own over DDS, killed and restarted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cdrj_msgs.srv import SetPreload
from std_srvs.srv import Trigger
from support.remote import ROBOT, Remote

from cdrj_ros.estimation.samples import Sample, Samples
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.prepared import Model

MOTOR = Template(JOINT_STATE, ("winch",), ("position",))
JOINT = Template(JOINT_STATE, ("elbow",), ("position",))
RAW = {"tracking_bandwidth": 0.0}
"""No filter between counts, since the tests compare with run()."""


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(ROBOT)


@pytest.fixture(scope="module")
def readings(model: Model, recorded: Callable[[Model, int], Samples]) -> Samples:
    """Recorded angles of six cycles, at 250 Hz."""
    return recorded(model, 6)


def send(remote: Remote, readings: Samples, first: int, last: int) -> None:
    """Send readings; wait for the estimates."""
    begin = len(remote.answers)
    for k in range(first, last):
        stamp = int(readings.stamp_ns[k])
        joint = JOINT.encode(stamp, position=readings.joint_angle[k])
        remote.inputs["joint_states"].publish(joint)
        motor = MOTOR.encode(stamp, position=readings.motor_angle[k])
        remote.inputs["motor_states"].publish(motor)
        if k % 100 == 99:
            remote.until(lambda: len(remote.answers) > begin + k - first - 200)  # noqa: B023
    assert remote.until(lambda: len(remote.answers) == begin + last - first)


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
