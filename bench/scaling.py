"""Cost per pulley of one cable, from seven pulleys to ten thousand.

Cable length, total wrap and total contact stiffness stay the same and are divided among the
pulleys, so that all sizes see the same tensions and differ only in the number of pulleys.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from bench.figures import Row, compared, in_turn
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Anchor, Cable, Friction, Motor, Profile, Pulley, Robot, Winch

PULLEYS = (7, 100, 10_000)
ROUNDS = 5
SAMPLES = 250
LENGTH = 1.0
"""Length of the cable, for any number of pulleys [m]."""
WRAP = 2.0
"""Total wrap of all pulleys [rad]; while sliding, the far end keeps 74 % of the tension."""
BRISTLES = 7e6
"""Total bristle stiffness of all pulleys [N/m]."""
DRUM = 0.015
"""Radius of the winch [m]."""
STRAIN = 2e-3
"""Amplitude of the cable's strain: ±12.6 N about the preload of 30 N."""
COUNTS = 81_920
"""Encoder counts per turn."""


def _constant(value: float) -> tuple[Profile]:
    empty = np.empty(0)
    return (Profile(None, empty, np.array([value]), empty),)


def chain(pulleys: int, length: float = LENGTH, stiffness: float | None = None) -> Model:
    """One cable from a winch over equal pulleys to an anchor.

    Args:
        pulleys: number of pulleys, which share ``WRAP``.
        length: of the cable [m].
        stiffness: bristle stiffness of each pulley [N/m]; None for its share of ``BRISTLES``.
    """
    friction = Friction(
        mu_c=0.15, mu_s=0.2, stribeck_speed=0.05, bristle_stiffness=stiffness or BRISTLES / pulleys
    )
    pulley = Pulley(0.01, friction, wrap=_constant(WRAP / pulleys))
    cable = Cable(
        "chain",
        6283.0,
        30.0,
        (Winch((("winch", 1.0),), DRUM, 1), *[pulley] * pulleys, Anchor()),
        (_constant(length / (pulleys + 1)),) * (pulleys + 1),
    )
    return prepare(Robot("chain", (Motor("winch"),), (), (cable,)))


def motion() -> Samples:
    """Encoder readings of one cycle of the winch straining the cable, at 1 kHz."""
    stamp = np.arange(1, SAMPLES + 1, dtype=np.int64) * 1_000_000
    angle = STRAIN * LENGTH / DRUM * np.sin(2.0 * pi * np.arange(SAMPLES) / SAMPLES)
    count = 2.0 * pi / COUNTS
    return Samples(stamp, (np.round(angle / count) * count)[:, None], np.empty((SAMPLES, 0)))


def _running(model: Model, samples: Samples, times: int) -> Callable[[], None]:
    def repeated() -> None:
        for _ in range(times):
            run(model, initial_state(model), samples)

    return repeated


def measure() -> list[Row]:
    """Time per pulley and sample [ns] and Newton iterations per sample."""
    functions, repeats, iterations = [], [], []
    for pulleys in PULLEYS:
        model, samples = chain(pulleys), motion()
        estimates = run(model, initial_state(model), samples)[1]
        layout = estimates.layout
        iterations.append(float(estimates.values[1:, layout.iterations].mean()))
        repeats.append(max(1, 2000 // pulleys))
        functions.append(_running(model, samples, repeats[-1]))
    times = in_turn(ROUNDS, *functions)
    cost = [
        np.array(taken) * 1e9 / (times_run * SAMPLES * pulleys)
        for taken, times_run, pulleys in zip(times, repeats, PULLEYS, strict=True)
    ]
    rows = []
    for k, pulleys in enumerate(PULLEYS[1:], start=1):
        rows.append(
            compared(
                f"per pulley and sample, {pulleys} pulleys, {iterations[k]:.1f} iterations",
                "ns",
                cost[k],
                f"{PULLEYS[0]} pulleys, {iterations[0]:.1f} iterations",
                cost[0],
                "flat",
            )
        )
    return rows
