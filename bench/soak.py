"""Feed an estimator process over DDS for a long time and check its answers: `make soak`.

    python -m bench.soak [--minutes M]

Motor and joint readings are sent at 1 kHz, each when the one before has been answered.  All answers
are counted, and the estimator's resident memory is printed once a minute.  Exit code 0: all bounds
are met; 1: a bound is violated.
"""

from __future__ import annotations

import argparse
import sys
from time import perf_counter

import numpy as np
import psutil

from bench.figures import ROBOT
from bench.roundtrip import PERIOD_NS, called, isolate, spin_until
from cdrj_ros.foundation.output import say
from cdrj_ros.model.prepared import load_model

MEMORY_GROWTH_MB = 5.0
"""Largest growth of resident memory after the first minute [MB]."""

SWING = 0.3 * np.sin(2.0 * np.pi * np.arange(7000) / 7000.0)[:, None]
"""Angles of the joint, again and again [rad]; the winch turns by 0.12 m over 15 mm per radian."""


def fed(node, minutes):
    """Send everything and print the memory; yields what violates a bound."""
    caller, samples = node.caller, round(minutes * 60e9 / PERIOD_NS)
    resident = []
    due = perf_counter()
    for k in range(1, samples + 1):
        due = max(due + PERIOD_NS * 1e-9, perf_counter() - 0.1)  # what was missed is not made up
        while (ahead := due - perf_counter()) > 0.0:
            caller.executor.spin_once(timeout_sec=ahead)
        caller.trip(*next(node.messages))
        if k % round(60e9 / PERIOD_NS) == 0 or k == samples:
            resident.append(psutil.Process(node.process.pid).memory_info().rss / 1e6)
            memory = f"{resident[-1]:.1f} MB resident"
            say(f"{k} sent, {caller.answers} answered, {memory}", flush=True)
    spin_until(caller.executor, lambda: caller.answers >= samples, node.process)
    if caller.backwards:
        yield f"{caller.backwards} answers were not later than the one before"
    if (growth := resident[-1] - resident[0]) > MEMORY_GROWTH_MB:
        yield f"resident memory grew by {growth:.1f} MB after the first minute"


def main():
    """Run the soak; returns the exit code."""
    parser = argparse.ArgumentParser(prog="soak", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0, help="how long (default 30)")
    minutes = parser.parse_args().minutes
    isolate()
    model = load_model(str(ROBOT))
    try:
        with called(ROBOT, model, 8.0 * SWING, SWING, PERIOD_NS) as node:
            violated = list(fed(node, minutes))
    except RuntimeError as error:
        violated = [str(error)]
    except KeyboardInterrupt:
        return 130
    for text in violated:
        say(f"violated: {text}")
    return 1 if violated else 0


if __name__ == "__main__":
    sys.exit(main())
