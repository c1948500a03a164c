"""An estimator in a process of its own over DDS, killed and restarted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from cdrj_msgs.srv import SetPreload
from std_srvs.srv import Trigger
from support.estimators import JOINT, MILLISECOND, MOTOR, sample_at
from support.remote import ROBOT, Remote

from cdrj_ros.estimation.samples import Sample
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.loading import load_model

RAW = {"tracking_bandwidth": 0.0}
"""No filter between counts, whose state is not kept."""


def at_rest(k: int) -> Sample:
    """Motion, and a rest from the hundredth sample on."""
    sample = sample_at(min(k, 100))
    return sample._replace(stamp_ns=sample.stamp_ns + max(k - 100, 0) * MILLISECOND)


def send(remote: Remote, first: int, last: int) -> None:
    """Send readings; wait for the estimates."""
    begin = len(remote.answers)
    for k in range(first, last):
        sample = at_rest(k)
        joint = JOINT.encode(sample.stamp_ns, position=sample.joint_angle)
        remote.inputs["joint_states"].publish(joint)
        motor = MOTOR.encode(sample.stamp_ns, position=sample.motor_angle)
        remote.inputs["motor_states"].publish(motor)
    assert remote.until(lambda: len(remote.answers) == begin + last - first)


def test_values_set_by_services_survive_a_kill(
    brisk_node: Any, start_node: Any, tmp_path: Path
) -> None:
    """The process is killed right after the response, before any further sample."""
    one = Remote(brisk_node, start_node, "set")
    arguments = ("--state-file", str(tmp_path / "state"))
    one.start(*arguments, **RAW)
    send(one, 0, 500)
    assert one.call(Trigger, "tare", Trigger.Request()).success
    request = SetPreload.Request(cable=["lower"], preload=[20.0])
    assert one.call(SetPreload, "set_preload", request).success
    one.kill()
    one.start(*arguments, **RAW)
    send(one, 500, 600)
    tension, _ = one.heard()
    assert np.allclose(tension[0, :8], 36.85)
    assert np.allclose(tension[0, 8:], 20.0)
    live = LiveEstimator(load_model(ROBOT))
    live.set_tracking(0.0)
    for k in range(500):
        live.take(at_rest(k))
    live.tare()
    live.set_preload({"lower": 20.0})
    assert np.array_equal(tension, [live.take(at_rest(k)).tension for k in range(500, 600)])
