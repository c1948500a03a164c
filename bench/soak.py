"""Feed an estimator process over DDS for a long time and check its answers: `make soak`.

    python -m bench.soak [--minutes M] [--rate HZ]

Motor readings at the given rate and joint readings at half of it are sent to an estimator process,
with invalid messages in between.  All answers are counted, and the estimator's resident memory is
printed once a minute.  Exit code 0: all bounds are met; 1: a bound is violated.

The sender waits while more than BEHIND messages are unanswered, so that load on the machine lowers
the rate instead of causing losses.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from math import cos, nan, sin
from time import monotonic, sleep
from typing import Any

import psutil

from bench.figures import ROBOT
from bench.processes import Process, estimator_command, isolate, listening, running, spin_until
from cdrj_ros.foundation.output import say
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template

MEMORY_GROWTH_MB = 5.0
"""Largest growth of resident memory after the first minute [MB]."""

BEHIND = 500
"""Number of unanswered messages above which the sender waits."""

HOSTILE_EVERY = 997
"""Number of messages after which one that must be refused is sent."""


class Feeder:
    """Sends readings and counts the answers of an estimator process."""

    def __init__(self, node: Any, executor: Any, process: Process, rate: float) -> None:
        """Subscribe to the answers."""
        from cdrj_msgs.msg import CableTensions
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState

        self._process, self._executor = process, executor
        qos = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)
        self._motors = node.create_publisher(JointState, "cdrj/motor_states", qos)
        self._joints = node.create_publisher(JointState, "cdrj/joint_states", qos)
        node.create_subscription(CableTensions, "cdrj/tensions", self._on_answer, qos, raw=True)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._motor = Template(JOINT_STATE, ("winch",), ("position",))
        self._joint = Template(JOINT_STATE, ("elbow",), ("position",))
        self._period_ns = round(1e9 / rate)
        self.counters: dict[str, str] = {}
        self.diagnosed = 0
        self.sent = 0
        self.answered = 0
        self.hostile = 0
        self.last_ns = 0
        self.backwards = 0

    def _on_answer(self, payload: bytes) -> None:
        stamp = int.from_bytes(payload[4:8], "little") * 10**9
        stamp += int.from_bytes(payload[8:12], "little")
        self.backwards += stamp <= self.last_ns
        self.last_ns = stamp
        self.answered += 1

    def _on_diagnostics(self, message: Any) -> None:
        self.counters = {value.key: value.value for value in message.status[0].values}
        self.diagnosed += 1

    def connected(self) -> bool:
        """Whether the estimator subscribes to both topics and publishes diagnostics."""
        readers = (self._motors.get_subscription_count(), self._joints.get_subscription_count())
        return all(readers) and bool(self.counters)

    def send(self) -> None:
        """Send the next motor reading, preceded by a joint reading every second time."""
        k = self.sent
        time = k * self._period_ns * 1e-9
        stamp = 1_700_000_000 * 10**9 + k * self._period_ns
        elbow = 0.3 * sin(0.9 * time)
        if k % 2 == 0:
            self._joints.publish(self._joint.encode(stamp, position=[elbow]))
        winch = 8.0 * sin(elbow) + 0.02 * (1.0 - cos(7.0 * time))  # 0.12 m a radian over 15 mm
        self._motors.publish(self._motor.encode(stamp, position=[winch]))
        self.sent += 1
        if k % HOSTILE_EVERY == HOSTILE_EVERY - 1:
            bad = (
                self._motor.encode(stamp, position=[0.0]),  # repeated
                self._motor.encode(stamp + 1, position=[nan]),
                self._motor.encode(stamp - 7, position=[0.0]),  # late
                self._motor.encode(0, position=[0.0]),  # unstamped
                b"\0\1\0\0 not a message",
            )
            self._motors.publish(bad[self.hostile % len(bad)])
            self.hostile += 1

    def wait_for(self, done: Callable[[], bool]) -> None:
        """Spin until ``done()``.

        Raises:
            RuntimeError: the process has ended or the time limit is exceeded.
        """
        spin_until(self._executor, done, self._process)

    def run(self, minutes: float, rate: float) -> Iterator[str]:
        """Send everything and print the memory; yields what violates a bound."""
        total, each = round(minutes * 60.0 * rate), round(60.0 * rate)
        resident: list[float] = []
        due = monotonic()
        while self.sent < total:
            while (ahead := due - monotonic()) > 0.0:
                self._executor.spin_once(timeout_sec=min(ahead, 0.001))
            due = max(due + 1.0 / rate, monotonic() - 0.1)  # what was missed is not made up
            self.wait_for(lambda: self.sent - self.answered < BEHIND)
            self.send()
            self._executor.spin_once(timeout_sec=0.0)
            if self.sent % each == 0 or self.sent == total:
                resident.append(psutil.Process(self._process.pid).memory_info().rss / 1e6)
                memory = f"{resident[-1]:.1f} MB resident"
                say(f"{self.sent} sent, {self.answered} answered, {memory}", flush=True)
        # a last motor reading without a joint reading of the same stamp is not answered
        expected = self.sent - (self.sent % 2 == 0)
        self.wait_for(lambda: self.answered >= expected)
        seen = self.diagnosed
        self.wait_for(lambda: self.diagnosed >= seen + 2)
        if self.backwards:
            yield f"{self.backwards} answers were not later than the one before"
        accepted = int(self.counters.get("readings accepted", "0"))
        refused = sum(int(v) for key, v in self.counters.items() if key.startswith("refused: "))
        readings = self.sent + (self.sent + 1) // 2
        say(f"{readings} readings, {accepted} accepted; {self.hostile} hostile, {refused} refused")
        if (accepted, refused) != (readings, self.hostile):
            yield "the counters of the estimator are others than what was sent"
        if resident and (growth := resident[-1] - resident[0]) > MEMORY_GROWTH_MB:
            yield f"resident memory grew by {growth:.1f} MB after the first minute"


def main() -> int:
    """Run the soak; returns the exit code."""
    parser = argparse.ArgumentParser(prog="soak", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0, help="how long (default 30)")
    parser.add_argument("--rate", type=float, default=1000.0, help="motor readings per second")
    arguments = parser.parse_args()
    isolate()
    with (
        running(*estimator_command(ROBOT)) as process,
        listening("soak") as (node, executor),
    ):
        feeder = Feeder(node, executor, process, arguments.rate)
        try:
            feeder.wait_for(feeder.connected)
            sleep(0.5)  # wait until both ends of every topic are matched
            violated = list(feeder.run(arguments.minutes, arguments.rate))
        except RuntimeError as error:
            violated = [f"{error}; {feeder.sent} sent, {feeder.answered} answered"]
        except KeyboardInterrupt:
            return 130
    for text in violated:
        say(f"violated: {text}")
    return 1 if violated else 0


if __name__ == "__main__":
    sys.exit(main())
