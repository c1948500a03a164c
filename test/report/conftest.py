"""Synthetic comparisons similar to the prototype's: hysteresis, noise, errors at reversals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support.compared import compare

from cdrj_ros.evaluation.channels import Angle, BagComparison

EPOCH_NS = 1_722_000_000_123_456_789


def make_comparison(
    duration_s: float = 60.0,
    rate_hz: float = 1000.0,
    elements: int = 8,
    nodes: int = 7,
    seed: int = 1,
    path: str = "bags/preload_36.85_26.26",
) -> BagComparison:
    """Two cables with ``elements`` and ``nodes`` each, two efforts, and a ±40° sine at 0.1 Hz."""
    random = np.random.default_rng(seed)
    n = int(duration_s * rate_hz)
    stamps = EPOCH_NS + np.arange(n, dtype=np.int64) * int(1e9 / rate_hz)
    time = np.arange(n) / rate_hz
    angle = np.radians(40.0) * np.sin(2 * np.pi * 0.1 * time)
    speed = np.cos(2 * np.pi * 0.1 * time)

    estimates: dict[str, np.ndarray] = {}
    references: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def add(name: str, elastic: np.ndarray, loss: float, error: float, noise: float) -> None:
        truth = elastic + loss * np.tanh(6.0 * np.roll(speed, int(0.35 * rate_hz)))
        guess = elastic * (1 + 0.2 * error) + loss * (1 + error) * np.tanh(
            6.5 * np.roll(speed, int(0.33 * rate_hz))
        )
        estimates[name] = guess
        references[name] = (stamps, truth + noise * random.standard_normal(n))

    for cable, sign, preload in (("upper", 1.0, 36.85), ("lower", -1.0, 26.26)):
        swing = preload + sign * 11.0 * np.sin(angle) + 6.0 * (1 - np.cos(2 * angle))
        for i in range(1, elements + 1):
            add(f"tension/{cable}/{i}", swing, sign * 0.55 * i, 0.02, 0.06)
        for i in range(1, nodes + 1):
            add(f"nodal_force/{cable}/{i}", 1.7 * swing, sign * 0.5 * i, -0.03, 0.1)
    add("effort/spindle", 0.12 * np.sin(angle), 0.03, 0.01, 4e-4)
    add("effort/rolling", 1.4 * np.sin(angle), 0.12, 0.05, 4e-3)
    channels = compare(
        stamps,
        estimates,
        references,
        max_gap_ns=20_000_000,
        angle=Angle("rolling joint", stamps, angle),
    )
    return BagComparison(
        path,
        duration_s,
        channels,
        counters={"motor sample not finite": 3, "joint sample late": 0},
        notes=("Simulated rig; truth uses contact divided into cells.",),
        facts={"rate achieved": "1000 Hz", "latency p50 / p99": "0.21 ms / 0.64 ms"},
    )


@pytest.fixture(scope="session")
def made_up() -> Callable[..., BagComparison]:
    """``make_comparison``, for tests with other parameters."""
    return make_comparison


@pytest.fixture(scope="session")
def comparison() -> BagComparison:
    """One minute at 1 kHz."""
    return make_comparison()
