"""Feed an estimator process over DDS for a long time and check its answers: `make soak`.

    python -m bench.soak [--minutes M]

Motor and joint readings are sent at 1 kHz, each when the one before has been answered, with
invalid messages in between.  All answers are counted, and the estimator's resident memory is
printed once a minute.  Exit code 0: all bounds are met; 1: a bound is violated.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from math import nan
from time import perf_counter
from typing import Any

import numpy as np
import psutil

from bench.figures import ROBOT
from bench.roundtrip import (
    PERIOD_NS,
    Called,
    Caller,
    estimator_command,
    isolate,
    listening,
    messages,
    running,
    spin_until,
)  # fmt: skip
from cdrj_ros.foundation.output import say
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.model.prepared import load_model

MEMORY_GROWTH_MB = 5.0
"""Largest growth of resident memory after the first minute [MB]."""

HOSTILE_EVERY = 997
"""Number of samples after which a message that must be refused is sent."""

SWING = 0.3 * np.sin(2.0 * np.pi * np.arange(7000) / 7000.0)[:, None]
"""Angles of the joint, again and again [rad]; the winch turns by 0.12 m over 15 mm per radian."""


def diagnoses(node: Any) -> list[dict[str, str]]:
    """The values of all diagnostics from now on."""
    from diagnostic_msgs.msg import DiagnosticArray

    heard: list[dict[str, str]] = []

    def on_diagnostics(message: Any) -> None:
        heard.append({value.key: value.value for value in message.status[0].values})

    node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 10)
    return heard


def hostile(stamp_ns: int) -> list[bytes]:
    """Messages that are refused after a sample."""
    encode = Template(JOINT_STATE, ("winch",), ("position",)).encode
    return [
        encode(stamp_ns, position=[0.0]),  # repeated
        encode(stamp_ns + 1, position=[nan]),
        encode(stamp_ns - 7, position=[0.0]),  # late
        encode(0, position=[0.0]),  # unstamped
        b"\0\1\0\0 not a message",
    ]


def fed(called: Called, heard: list[dict[str, str]], minutes: float) -> Iterator[str]:
    """Send everything and print the memory; yields what violates a bound."""
    caller, samples, refused = called.caller, round(minutes * 60e9 / PERIOD_NS), 0
    resident: list[float] = []
    due = perf_counter()
    for k in range(1, samples + 1):
        due = max(due + PERIOD_NS * 1e-9, perf_counter() - 0.1)  # what was missed is not made up
        while (ahead := due - perf_counter()) > 0.0:
            caller.executor.spin_once(timeout_sec=ahead)
        caller.trip(*next(called.messages))
        if k % HOSTILE_EVERY == 0:
            some = hostile(k * PERIOD_NS)
            caller.motors.publish(some[refused % len(some)])
            refused += 1
        if k % round(60e9 / PERIOD_NS) == 0 or k == samples:
            resident.append(psutil.Process(called.process.pid).memory_info().rss / 1e6)
            memory = f"{resident[-1]:.1f} MB resident"
            say(f"{k} sent, {caller.answers} answered, {memory}", flush=True)
    spin_until(caller.executor, lambda: caller.answers >= samples, called.process)
    seen = len(heard)
    spin_until(caller.executor, lambda: len(heard) >= seen + 2, called.process)
    if caller.backwards:
        yield f"{caller.backwards} answers were not later than the one before"
    counted = {key: int(n) for key, n in heard[-1].items() if n.isdigit()}
    accepted = counted.get("readings accepted", 0)
    turned_down = sum(n for key, n in counted.items() if key.startswith("refused: "))
    say(f"{accepted} of {2 * samples} accepted, {turned_down} of {refused} hostile refused")
    if (accepted, turned_down) != (2 * samples, refused):
        yield "the counters of the estimator are others than what was sent"
    if (growth := resident[-1] - resident[0]) > MEMORY_GROWTH_MB:
        yield f"resident memory grew by {growth:.1f} MB after the first minute"


def main() -> int:
    """Run the soak; returns the exit code."""
    parser = argparse.ArgumentParser(prog="soak", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0, help="how long (default 30)")
    minutes = parser.parse_args().minutes
    isolate()
    layout = load_model(str(ROBOT)).layout
    with (
        running(*estimator_command(ROBOT)) as process,
        listening("soak") as (node, executor),
    ):
        caller, heard = Caller(node, executor, "cdrj"), diagnoses(node)
        called = Called(caller, messages(layout, 8.0 * SWING, SWING, PERIOD_NS), process)
        try:
            spin_until(executor, caller.is_connected, process)
            spin_until(executor, lambda: bool(heard), process)
            violated = list(fed(called, heard, minutes))
        except RuntimeError as error:
            violated = [f"{error}; {caller.answers} answered"]
        except KeyboardInterrupt:
            return 130
    for text in violated:
        say(f"violated: {text}")
    return 1 if violated else 0


if __name__ == "__main__":
    sys.exit(main())
