"""The winch drum is a stack: cable wound last is unwound first, at the strain it was wound with."""

from __future__ import annotations

import numpy as np
import pytest

from cdrj_ros._core import Drum
from cdrj_ros.model.cable_records import CAPACITY, FIRST_SPACING

RADIUS, STIFFNESS = 0.015, 6283.0


def rate(tension: float) -> float:
    """Unstretched material per radian [m/rad] of layers laid at a tension [N]."""
    return RADIUS / (1.0 + tension / STIFFNESS)


def fresh(angle: float = 0.0, tension: float = 20.0) -> Drum:
    return Drum(angle, rate(tension) * angle, rate(tension))


def turn(memory: Drum, begin: float, end: float, tension: float, steps: int = 200) -> float:
    """Turn evenly from begin to end; returns the material held there."""
    for angle in np.linspace(begin, end, steps + 1)[1:]:
        memory.turn(angle, rate(tension))
    return memory.held


def test_a_layer_takes_up_material_at_the_strain_of_the_moment() -> None:
    memory = fresh()
    assert turn(memory, 0.0, 3.0, 60.0) == pytest.approx(3.0 * rate(60.0), rel=1e-12)
    assert turn(memory, 3.0, 5.0, 10.0) == pytest.approx(
        3.0 * rate(60.0) + 2.0 * rate(10.0), rel=1e-12
    )


def test_last_on_is_first_off() -> None:
    memory = fresh()
    first = turn(memory, 0.0, 4.0, 60.0)
    second = turn(memory, 4.0, 7.0, 10.0)
    # regardless of the current tension, the loose layer comes off first, then the tight one
    assert second - turn(memory, 7.0, 5.0, 90.0) == pytest.approx(2.0 * rate(10.0), rel=1e-9)
    # where two layers meet within one spacing they are joined by a chord
    chord = 0.25 * FIRST_SPACING * (rate(10.0) - rate(60.0))
    assert turn(memory, 5.0, 4.0, 0.0) == pytest.approx(first, abs=chord)
    assert first - turn(memory, 4.0, 1.0, 35.0) == pytest.approx(3.0 * rate(60.0), abs=chord)


def test_material_held_is_what_turning_has_returned() -> None:
    generator = np.random.default_rng(3)
    memory = fresh()
    for angle in np.cumsum(generator.normal(size=500)):
        assert memory.turn(angle, rate(generator.uniform(0, 90))) == memory.held


def test_a_cycle_wound_tight_and_unwound_loose_returns_the_same_material_exactly() -> None:
    memory = fresh(angle=1.25)
    begin = memory.held
    rate_form = begin
    for _ in range(100):
        turn(memory, 1.25, 6.5, 60.0)
        assert turn(memory, 6.5, 1.25, 20.0) == begin
        rate_form += (6.5 - 1.25) * (rate(60.0) - rate(20.0))
    # ds = -r dphi / (1 + t / EA) alone would have fed out half a cable of a metre in these cycles
    assert abs(rate_form - begin) > 0.04


def test_a_drum_at_rest_keeps_its_material_to_the_bit() -> None:
    memory = fresh()
    held = turn(memory, 0.0, 2.345, 33.0)
    for tension in (0.0, 20.0, 90.0):
        assert memory.turn(2.345, rate(tension)) == held


def test_dithering_by_a_count_moves_no_material() -> None:
    count = 2 * np.pi / 81_920
    memory = fresh()
    held = turn(memory, 0.0, 2.0, 50.0)
    rate_form = held
    for _ in range(20_000):
        memory.turn(2.0 + count, rate(60.0))
        memory.turn(2.0, rate(20.0))
        rate_form += count * (rate(60.0) - rate(20.0))
    # bounded by one spacing laid at the other strain, for any number of repetitions
    assert abs(memory.held - held) <= FIRST_SPACING * (rate(20.0) - rate(60.0))
    assert abs(rate_form - held) > 5 * FIRST_SPACING * (rate(20.0) - rate(60.0))


def test_cycles_between_any_turning_points_do_not_drift() -> None:
    generator = np.random.default_rng(4)
    for _ in range(10):
        memory = fresh()
        low, high = np.sort(generator.uniform(0.3, 6.0, 2)) + np.array([0.0, 0.5])
        begin = turn(memory, 0.0, low, 40.0)
        held = []
        for _ in range(200):
            turn(memory, low, high, generator.uniform(50, 90), 40)
            held.append(turn(memory, high, low, generator.uniform(0, 30), 40))
        assert np.abs(np.array(held) - begin).max() <= FIRST_SPACING * (rate(0.0) - rate(90.0))


def test_below_the_start_lies_cable_of_the_first_strain() -> None:
    memory = fresh(angle=0.5, tension=20.0)
    begin = memory.held
    turn(memory, 0.5, 2.0, 80.0)
    assert begin - turn(memory, 2.0, -3.0, 70.0) == pytest.approx(3.5 * rate(20.0), rel=1e-12)
    assert turn(memory, -3.0, -1.0, 70.0) == pytest.approx(
        begin - 3.5 * rate(20.0) + 2.0 * rate(70.0), rel=1e-12
    )


def test_more_material_lies_on_the_drum_the_further_it_is_wound() -> None:
    generator = np.random.default_rng(5)
    memory = fresh()
    angle, held = 0.0, memory.held
    for _ in range(5000):
        to = angle + generator.normal() * 10.0 ** generator.uniform(-4, 0.5)
        now = memory.turn(to, rate(generator.uniform(0, 100)))
        assert (now - held) * (to - angle) >= 0.0
        slope = (now - held) / (to - angle)
        assert rate(100.0) * (1.0 - 1e-6) <= slope <= RADIUS * (1.0 + 1e-6)
        angle, held = to, now


def test_memory_stays_bounded_and_its_error_tiny_over_two_hundred_turns() -> None:
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
