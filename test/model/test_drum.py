"""The winch drum is a stack: cable wound last is unwound first, at the strain it was wound with."""

import numpy as np
import pytest

from cdrj_ros._core import Drum
from cdrj_ros.model.packing import Sizes, parts_of

RADIUS, STIFFNESS = 0.015, 6283.0
CAPACITY = parts_of(Sizes(*[0] * 11))["state"]["drums"].record["angle"].shape[0]
FIRST_SPACING = 0.1
"""Distance of break points until the memory is full for the first time [rad]."""


def rate(tension):
    """Unstretched material per radian [m/rad] of layers laid at a tension [N]."""
    return RADIUS / (1.0 + tension / STIFFNESS)


def fresh(angle=0.0, tension=20.0):
    return Drum(angle, rate(tension) * angle, rate(tension))


def turn(memory, begin, end, tension, steps=200):
    """Turn evenly from begin to end; returns the material held there."""
    for angle in np.linspace(begin, end, steps + 1)[1:]:
        memory.turn(angle, rate(tension))
    return memory.held


def test_last_on_is_first_off():
    memory = fresh()
    first = turn(memory, 0.0, 4.0, 60.0)
    second = turn(memory, 4.0, 7.0, 10.0)
    # regardless of the current tension, the loose layer comes off first, then the tight one
    assert second - turn(memory, 7.0, 5.0, 90.0) == pytest.approx(2.0 * rate(10.0), rel=1e-9)
    # where two layers meet within one spacing they are joined by a chord
    chord = 0.25 * FIRST_SPACING * (rate(10.0) - rate(60.0))
    assert turn(memory, 5.0, 4.0, 0.0) == pytest.approx(first, abs=chord)
    assert first - turn(memory, 4.0, 1.0, 35.0) == pytest.approx(3.0 * rate(60.0), abs=chord)


def test_a_cycle_wound_tight_and_unwound_loose_returns_the_same_material_exactly():
    memory = fresh(angle=1.25)
    begin = memory.held
    rate_form = begin
    for _ in range(100):
        turn(memory, 1.25, 6.5, 60.0)
        assert turn(memory, 6.5, 1.25, 20.0) == begin
        rate_form += (6.5 - 1.25) * (rate(60.0) - rate(20.0))
    # ds = -r dphi / (1 + t / EA) alone would have fed out half a cable of a metre in these cycles
    assert abs(rate_form - begin) > 0.04


def test_memory_stays_bounded_and_its_error_tiny_over_two_hundred_turns():
    memory = fresh()
    top = 200 * 2 * np.pi
    angles = np.arange(0.0, top, 0.01)
    tensions = 40.0 + 30.0 * np.sin(2 * np.pi * angles / top) + 0.02 * angles
    rates = RADIUS / (1.0 + tensions / STIFFNESS)
    exact = np.concatenate([[0.0], np.cumsum(np.diff(angles) * rates[1:])])
    spacings = set()
    for angle, laid in zip(angles[1:], rates[1:], strict=True):
        memory.turn(angle, laid)
        spacings.add(float(memory.spacing))
        assert 1 <= memory.points <= CAPACITY
    assert len(spacings) > 5, "the memory was thinned out repeatedly"
    assert memory.held == pytest.approx(exact[-1], rel=1e-12)
    errors = [
        memory.turn(angle, rate(0.0)) - wound
        for angle, wound in zip(angles[::-1], exact[::-1], strict=True)
    ]
    # of 18.8 m on the drum; in tension that is EA * error / length
    assert np.abs(errors).max() < 5e-5
    assert STIFFNESS * np.abs(errors).max() / exact[-1] < 0.02
    assert errors[-1] == pytest.approx(0.0, abs=1e-15)
