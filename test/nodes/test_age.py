"""Estimates older than the timeout are STALE, whatever made them old."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from time import time_ns
from typing import Any

import numpy as np
import pytest
from support.estimators import (
    BEGIN,
    ROBOT,
    SECOND,
    Bench,
    Clock,
    feed,
    hear_diagnostics,
    tensions,
)

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, read_layout
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.status import STALE
from cdrj_ros.nodes.silence import age_s, stale_before_ns

MS = 1_000_000
MOTOR = Template(JOINT_STATE, ("winch",), ("position",))
JOINT = Template(JOINT_STATE, ("elbow",), ("position",))


@pytest.fixture
def bench(ros: None) -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def test_readings_of_another_clock_have_no_age_by_this_one() -> None:
    assert stale_before_ns(100 * SECOND, 110 * SECOND, 0.5) == 110 * SECOND - SECOND // 2
    assert stale_before_ns(100 * SECOND, 161 * SECOND, 0.5) == 100 * SECOND - SECOND // 2
    assert stale_before_ns(100 * SECOND, 110 * SECOND, 0.5, 5.0) == 100 * SECOND - SECOND // 2
    assert stale_before_ns(100 * SECOND, 161 * SECOND, 0.5, 1e10) == 161 * SECOND - SECOND // 2
    assert stale_before_ns(100 * SECOND, 99 * SECOND, 0.5) == 100 * SECOND - SECOND // 2
    assert age_s(100 * SECOND, 110 * SECOND, 0.1, 0.2) == 10.0
    assert age_s(100 * SECOND, 110 * SECOND, 0.1, 0.2, 5.0) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("late_s", "within_s", "stale"),
    [(0.4, 60.0, False), (10.0, 60.0, True), (10.0, 5.0, False), (100.0, 60.0, False),
     (100.0, 3600.0, True)],
)  # fmt: skip
def test_where_all_inputs_are_late_alike_the_estimates_are_stale(
    late_s: float, within_s: float, stale: bool, bench: Bench
) -> None:
    node = bench.estimator(use_sim_time=True, timeout=0.5, same_clock_within=within_s)
    said: list[Any] = []
    hear_diagnostics(bench, said)
    status: list[np.ndarray] = []
    published = node.tensions.publish

    def publish(payload: bytes) -> None:
        found = read_layout(payload, CABLE_TENSIONS.fields).numbers["status"]
        status.append(np.frombuffer(payload, found.dtype, found.count, found.offset))
        published(payload)

    node.tensions.publish = publish
    node.watch.lost = lambda: False  # the last estimate is not to be published again
    clock = Clock(bench, node)
    assert bench.until(lambda: bench.node.count_publishers("/diagnostics") > 0)
    for k in range(0, 60, 20):
        clock.set(BEGIN + k * MS + round(late_s * 1e9))
        feed(node, k, k + 20)
    assert len(status) == len(tensions(node)) == 60
    assert all(bool(np.all(one & STALE)) == stale for one in status)
    assert any(bool(np.all(one & STALE)) for one in status) == stale
    if stale:
        assert node.watch.health(node.output, 1.0, 0).age_s > 0.5
        node._on_diagnostics()
        assert bench.until(lambda: bool(said))
        assert said[-1].level != said[-1].OK


def test_what_waited_while_the_process_was_stopped_is_stale(
    node: Any, start_node: Any, recorded: Callable[..., Samples]
) -> None:
    """SIGSTOP for 1.9 s, as a debugger or a suspended machine does."""
    import rclpy
    from cdrj_msgs.msg import CableTensions
    from sensor_msgs.msg import JointState

    readings = recorded(load_model(ROBOT), 15)
    heard: dict[int, int] = {}

    def hear(payload: bytes) -> None:
        found = read_layout(payload, CABLE_TENSIONS.fields)
        arrays = {
            name: np.frombuffer(payload, one.dtype, one.count, one.offset)
            for name, one in found.numbers.items()
        }
        stamp = int(arrays["header.stamp.sec"][0]) * SECOND + int(arrays["header.stamp.nanosec"][0])
        heard.setdefault(stamp, int(np.bitwise_or.reduce(arrays["status"])))

    node.create_subscription(CableTensions, "/stopped/tensions", hear, 2000, raw=True)
    motors = node.create_publisher(JointState, "/stopped/motor_states", 2000)
    joints = node.create_publisher(JointState, "/stopped/joint_states", 2000)
    process = start_node(
        "estimator", "--ros-args", "-r", "__ns:=/stopped", "-p", f"robot:={ROBOT}",
        "-p", "timeout:=0.5",
    )  # fmt: skip
    sent: list[int] = []

    def send() -> None:
        """One reading of each axis, stamped now."""
        sent.append(time_ns())
        k = len(sent) % readings.stamp_ns.size
        joints.publish(JOINT.encode(sent[-1], position=readings.joint_angle[k]))
        motors.publish(MOTOR.encode(sent[-1], position=readings.motor_angle[k]))
        rclpy.spin_once(node, timeout_sec=0.01)

    def send_until(condition: Callable[[], bool], patience_s: float = 120.0) -> None:
        begin = time_ns()
        while not condition():
            assert time_ns() - begin < patience_s * SECOND
            send()

    def fresh() -> bool:
        return any(stamp > since and not flags & STALE for stamp, flags in heard.items())

    since = 0
    send_until(fresh)
    os.kill(process.pid, signal.SIGSTOP)
    try:
        stopped = time_ns()
        send_until(lambda: time_ns() - stopped > 1_900 * MS)
    finally:
        since = time_ns()
        os.kill(process.pid, signal.SIGCONT)
    send_until(fresh)
    # read after the process went on, which is more than the timeout after their stamps
    waited = [
        flags
        for stamp, flags in heard.items()
        if stopped + SECOND // 5 < stamp < since - SECOND // 2
    ]
    assert len(waited) > 20
    assert all(flags & STALE for flags in waited)
