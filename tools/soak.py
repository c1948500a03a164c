"""Feed an estimator process over DDS for a long time and check its answers: `make soak`.

    python tools/soak.py [--minutes M] [--rate HZ]

Motor readings at the given rate and joint readings at half of it are sent to an estimator process.
All answers are counted, and the estimator's resident memory is read once a minute.
Invalid messages are sent in between.  Exit code 0: all bounds are met; 1: a bound is violated; 2:
the soak cannot run.

The sender waits while more than BEHIND messages are unanswered, so that load on the machine lowers
the rate instead of causing losses; the waiting time is recorded.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from math import cos, nan, sin
from pathlib import Path
from time import monotonic, sleep
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
ROBOT = ROOT / "config" / "robots" / "prototype.yaml"

MEMORY_GROWTH_MB = 5.0
"""Largest growth of resident memory after the first minute [MB]."""

BEHIND = 500
"""Number of unanswered messages above which the sender waits."""

PATIENCE_S = 60.0
HOSTILE_EVERY = 997
"""Number of messages after which one that must be refused is sent."""


@dataclass
class Minute:
    """Measurements of one minute."""

    minute: float
    sent: int
    answered: int
    resident_mb: float
    waited_s: float


@dataclass
class Soak:
    """All measurements and violated bounds."""

    minutes: list[Minute] = field(default_factory=list)
    hostile_sent: int = 0
    refused: int = 0
    accepted: int = 0
    readings_sent: int = 0
    broken: list[str] = field(default_factory=list)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="soak", description=__doc__.split("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0, help="how long (default 30)")
    parser.add_argument("--rate", type=float, default=1000.0, help="motor readings per second")
    arguments = parser.parse_args()
    if not 0.0 < arguments.minutes <= 10_000.0 or not 1.0 <= arguments.rate <= 10_000.0:
        parser.error("minutes must be in (0, 10000] and rate in [1, 10000]")
    return arguments


class Feeder:
    """Sends readings at a rate and counts the answers."""

    def __init__(self, rate: float) -> None:
        from cdrj_msgs.msg import CableTensions
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.experimental import EventsExecutor
        from rclpy.node import Node
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import JointState

        from cdrj_ros.messages.cdr import JOINT_STATE
        from cdrj_ros.messages.templates import Template

        self.node = Node("soak", namespace="cdrj")
        self.executor = EventsExecutor()
        self.executor.add_node(self.node)
        qos = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)
        self._motors = self.node.create_publisher(JointState, "motor_states", qos)
        self._joints = self.node.create_publisher(JointState, "joint_states", qos)
        self.node.create_subscription(CableTensions, "tensions", self._on_answer, qos, raw=True)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._motor = Template(JOINT_STATE, ("winch",), ("position",))
        self._joint = Template(JOINT_STATE, ("elbow",), ("position",))
        self._period_ns = round(1e9 / rate)
        self._begin_ns = 1_700_000_000 * 10**9
        self.values: dict[str, str] = {}
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
        self.values = {value.key: value.value for value in message.status[0].values}
        self.diagnosed += 1

    @property
    def connected(self) -> bool:
        """Whether the estimator subscribes to both topics and publishes diagnostics."""
        return all(
            publisher.get_subscription_count() for publisher in (self._motors, self._joints)
        ) and bool(self.values)

    def send(self) -> None:
        """Send the next motor reading, preceded by a joint reading every second time."""
        k = self.sent
        stamp = self._begin_ns + k * self._period_ns
        time = k * self._period_ns * 1e-9
        elbow = 0.3 * sin(0.9 * time)
        if k % 2 == 0:
            self._joints.publish(self._joint.encode(stamp, position=[elbow]))
        winch = 8.0 * sin(elbow) + 0.02 * (1.0 - cos(7.0 * time))  # 0.12 m a radian over 15 mm
        self._motors.publish(self._motor.encode(stamp, position=[winch]))
        self.sent += 1
        if k % HOSTILE_EVERY == HOSTILE_EVERY - 1:
            self._send_hostile(stamp, k // HOSTILE_EVERY)

    def _send_hostile(self, stamp: int, k: int) -> None:
        bad = (
            self._motor.encode(stamp, position=[0.0]),  # repeated
            self._motor.encode(stamp + 1, position=[nan]),
            self._motor.encode(stamp - 7, position=[0.0]),  # late
            self._motor.encode(0, position=[0.0]),  # unstamped
            b"\0\1\0\0 not a message",
        )
        self._motors.publish(bad[k % len(bad)])
        self.hostile += 1

    def wait_for(self, done: Any, process: subprocess.Popen[bytes], patience_s: float) -> bool:
        """Spin until ``done()``; False if the process has ended or the time limit is exceeded."""
        deadline = monotonic() + patience_s
        while not done():
            if monotonic() > deadline or process.poll() is not None:
                return False
            self.executor.spin_once(timeout_sec=0.01)
        return True


def _run(feeder: Feeder, process: subprocess.Popen[bytes], minutes: float, rate: float) -> Soak:
    import psutil

    from cdrj_ros.foundation.output import ProgressBar

    soak = Soak()
    resident = psutil.Process(process.pid)
    total = round(minutes * 60.0 * rate)
    each = round(60.0 * rate)
    waited = 0.0
    begin = monotonic()
    shift = 0.0
    with ProgressBar("soak", float(total)) as show:
        while feeder.sent < total and process.poll() is None:
            due = begin + shift + feeder.sent / rate
            ahead = due - monotonic()
            if ahead > 0.0:
                feeder.executor.spin_once(timeout_sec=min(ahead, 0.001))
                continue
            if feeder.sent - feeder.answered > BEHIND:
                stopped = monotonic()
                if not feeder.wait_for(
                    lambda: feeder.sent - feeder.answered < BEHIND // 2, process, PATIENCE_S
                ):
                    break
                waited += monotonic() - stopped
                shift = monotonic() - begin - feeder.sent / rate
                continue
            feeder.send()
            feeder.executor.spin_once(timeout_sec=0.0)
            show(feeder.sent)
            if feeder.sent % each == 0 or feeder.sent == total:
                soak.minutes.append(
                    Minute(
                        round(feeder.sent / each, 2),
                        feeder.sent,
                        feeder.answered,
                        round(resident.memory_info().rss / 1e6, 2),
                        round(waited, 2),
                    )
                )
                waited = 0.0
    _settle(feeder, process, soak)
    return soak


def _settle(feeder: Feeder, process: subprocess.Popen[bytes], soak: Soak) -> None:
    """Wait for the last answers and the last counters."""
    # a last motor reading without a joint reading of the same stamp is not answered
    expected = feeder.sent - (feeder.sent % 2 == 0)
    feeder.wait_for(lambda: feeder.answered >= expected, process, PATIENCE_S)
    seen = feeder.diagnosed
    feeder.wait_for(lambda: feeder.diagnosed >= seen + 2, process, PATIENCE_S)
    soak.hostile_sent = feeder.hostile
    soak.readings_sent = feeder.sent + (feeder.sent + 1) // 2
    soak.accepted = int(feeder.values.get("readings accepted", "0"))
    soak.refused = sum(int(v) for key, v in feeder.values.items() if key.startswith("refused: "))
    broken = soak.broken
    if process.poll() is not None:
        broken.append(f"the estimator ended with exit code {process.returncode}")
    if feeder.answered != expected:
        broken.append(f"{expected} answers expected, {feeder.answered} received")
    if feeder.backwards:
        broken.append(f"{feeder.backwards} answers were not later than the one before")
    if soak.accepted != soak.readings_sent or soak.refused != soak.hostile_sent:
        broken.append(
            f"{soak.readings_sent} readings and {soak.hostile_sent} hostile messages sent, "
            f"{soak.accepted} accepted and {soak.refused} refused"
        )
    if len(soak.minutes) > 1:
        growth = soak.minutes[-1].resident_mb - soak.minutes[0].resident_mb
        if growth > MEMORY_GROWTH_MB:
            broken.append(f"resident memory grew by {growth:.1f} MB after the first minute")


def _print(soak: Soak) -> None:
    print("minute      sent  answered  resident [MB]  waited [s]")
    for one in soak.minutes:
        print(
            f"{one.minute:6.1f} {one.sent:9d} {one.answered:9d} {one.resident_mb:14.1f} "
            f"{one.waited_s:11.1f}"
        )
    print(
        f"readings sent {soak.readings_sent}, accepted {soak.accepted}; hostile messages sent "
        f"{soak.hostile_sent}, refused {soak.refused}"
    )
    for text in soak.broken:
        print(f"violated: {text}")
    if not soak.broken:
        print("all bounds are met")


def main() -> int:
    """Run the soak; returns the exit code."""
    arguments = _arguments()
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    import rclpy
    from ament_index_python.packages import get_package_prefix

    executable = Path(get_package_prefix("cdrj_ros"), "lib", "cdrj_ros", "estimator")
    process = subprocess.Popen(
        [executable, "--supervised", "--ros-args", "-p", f"robot:={ROBOT}", "-p", "timeout:=3600.0"]
    )
    rclpy.init(args=[])
    feeder = Feeder(arguments.rate)
    try:
        if not feeder.wait_for(lambda: feeder.connected, process, PATIENCE_S):
            print("soak: the estimator did not start", file=sys.stderr)
            return 2
        sleep(0.5)  # wait until both ends of every topic are matched
        soak = _run(feeder, process, arguments.minutes, arguments.rate)
    except KeyboardInterrupt:
        print("soak: interrupted", file=sys.stderr)
        return 130
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(PATIENCE_S)
        feeder.executor.shutdown()
        feeder.node.destroy_node()
        rclpy.try_shutdown()
    _print(soak)
    return 1 if soak.broken else 0


if __name__ == "__main__":
    sys.exit(main())
