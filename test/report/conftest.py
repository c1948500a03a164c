"""Synthetic comparisons similar to the prototype's: two cables, hysteresis, noise."""

import numpy as np
import pytest

from cdrj_ros.evaluation.channels import BagComparison, Channel


def make_comparison(seconds=60, per_cable=8):
    """Tensions and forces of two cables and two efforts over a sine of 0.1 Hz, at 1 kHz."""
    random = np.random.default_rng(1)
    time = np.arange(1000 * seconds) * 1e-3
    stamps = 1_722_000_000_123_456_789 + np.round(1e9 * time).astype(np.int64)
    angle, way = np.sin(0.2 * np.pi * time), np.tanh(6.0 * np.cos(0.2 * np.pi * time))
    channels = []

    def add(name, unit, elastic, loss):
        truth = elastic + loss * way
        estimate = truth + 0.02 * loss * np.roll(way, 20)
        noisy = truth + 0.01 * loss * random.standard_normal(time.size)
        channels.append(Channel(name, unit, stamps, estimate, noisy, angle, "rolling joint"))

    for cable, sign in (("upper", 1.0), ("lower", -1.0)):
        for i in range(1, per_cable + 1):
            add(f"tension/{cable}/{i}", "N", 30.0 + sign * 11.0 * angle, sign * 0.55 * i)
        for i in range(1, per_cable):
            add(f"nodal_force/{cable}/{i}", "N", 50.0 + sign * 20.0 * angle, sign * 0.5 * i)
    for name in ("spindle", "rolling"):
        add(f"effort/{name}", "N·m", 0.12 * angle, 0.03)
    return BagComparison(
        "bags/preload_36.85_26.26", float(seconds), tuple(channels),
        {"motor sample not finite": 3, "joint sample late": 0},
        ("Simulated rig; truth uses contact divided into cells.",),
        {"rate achieved": "1000 Hz", "latency p50 / p99": "0.21 ms / 0.64 ms"},
    )  # fmt: skip


@pytest.fixture(scope="session")
def made_up():
    """``make_comparison``, for tests with other parameters."""
    return make_comparison


@pytest.fixture(scope="session")
def comparison():
    """One minute at 1 kHz."""
    return make_comparison()
