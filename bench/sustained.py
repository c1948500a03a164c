"""Highest rate of samples at which a node answers all of them without falling behind."""

from __future__ import annotations

from time import perf_counter

from bench.figures import Row, alone
from bench.roundtrip import Called, callers

TRIAL_S = 1.0
"""Duration of a trial."""
BEHIND_S = 0.05
"""Time after the last sample within which all answers must have arrived."""
DRAIN_S = 0.3
"""A node that sends nothing for this long has finished with an earlier trial."""
LOWEST_HZ = 500.0
BISECTIONS = 4


def _answered(called: Called) -> int:
    return min(called.caller.heard.values())


def _drain(called: Called) -> None:
    """Wait until a node that fell behind has stopped sending, at most five seconds."""
    deadline = perf_counter() + 5.0
    total, since = -1, perf_counter()
    while perf_counter() < min(deadline, since + DRAIN_S):
        called.caller.executor.spin_once(timeout_sec=0.01)
        if (now := sum(called.caller.heard.values())) != total:
            total, since = now, perf_counter()


def holds(called: Called, rate_hz: float) -> bool:
    """Whether all three messages answer every sample of a trial at this rate in time.

    All but the last one, whose reading the estimator may hold until the next.
    """
    caller, count = called.caller, int(rate_hz * TRIAL_S)
    _drain(called)
    awaited = {topic: heard + count for topic, heard in caller.heard.items()}
    begin = perf_counter()
    for k in range(count):
        joint, motor = next(called.messages)
        caller.joints.publish(joint)
        caller.motors.publish(motor)
        due = begin + (k + 1) / rate_hz
        while (left := due - perf_counter()) > 0.0:
            caller.executor.spin_once(timeout_sec=left)
    late = begin + TRIAL_S + BEHIND_S
    while perf_counter() < late:
        caller.executor.spin_once(timeout_sec=0.001)
        if all(caller.heard[topic] >= number - 1 for topic, number in awaited.items()):
            return True
    return False


def highest(called: Called) -> float:
    """Rate [Hz] found by doubling, then by bisection; 0 if even the lowest is too high."""
    low, high = 0.0, LOWEST_HZ
    while holds(called, high):
        low, high = high, 2.0 * high
    if low == 0.0:
        return 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(called, middle) else (low, middle)
    return low


def measure() -> list[Row]:
    """Rate [kHz] of the estimator; the caller's own limit bounds it."""
    with callers() as nodes:
        ours = 1e-3 * highest(nodes[0])
    return [alone("sustained rate, no sample lost", "kHz", ours, "≥ 4")]
