"""A slack cable costs what a taut one costs, and its tensions are those of its equations (E11)."""

from dataclasses import replace
from itertools import pairwise
from math import exp

import numpy as np
import pytest
from support.chain import DRUM, chain
from support.state import state_views

from cdrj_ros.estimation.estimator import Sample, Samples, initial_state, run, step
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.description import Pulley

SCALES = (0.0, *(10.0**k for k in range(-12, 0)))
"""Bearing torques of pulleys with a radius of 1 cm [N m]."""

MU, WRAP, BRISTLES = 0.15, 1.0, 1e6
STIFFNESS, RADIUS = 6283.0, 0.01
LENGTH = [1.0 / 3.0 + share * WRAP * RADIUS for share in (0.5, 1.0, 0.5)]
"""Of the three elements between two pulleys, with their shares of both arcs [m]."""

MOST = 80
"""Iterations of the hardest sample; from one first guess it takes at most 20."""


def robot(torque, pulleys=2):
    """One cable over pulleys with sliding friction and the torque, or 0.7 of it at every other."""
    plain = chain(pulleys, stiffness=BRISTLES).robot
    cable, bearings = plain.cables[0], (0.7 * torque, torque)
    nodes = [
        replace(
            node, cells=1, bearing_torque=bearings[k % 2], friction=replace(node.friction, mu_s=MU)
        )
        if isinstance(node, Pulley)
        else node
        for k, node in enumerate(cable.nodes)
    ]
    return prepare(replace(plain, cables=(replace(cable, nodes=tuple(nodes)),)))


def paid_out(stretch):
    """Angles of the winch that shorten the cable by these lengths [m], 5 ms apart."""
    stamps = np.arange(1, stretch.size + 1, dtype=np.int64) * 5_000_000
    return Samples(stamps, (stretch / DRUM)[:, None], np.empty((stretch.size, 0)))


def motion():
    """Taut, slack and taut again: steadily, by small reversals, and by jumps [m]."""
    wave = 6e-3 * (np.cos(np.linspace(0.0, 4.0 * np.pi, 120)) - 1.0)
    small = -5e-3 + 1e-4 * np.sin(np.linspace(0.0, 6.0 * np.pi, 40))
    jumps = np.random.default_rng(2).uniform(-0.03, 0.01, 60)
    return np.concatenate([wave, small, np.linspace(-5e-3, 2e-3, 30), jumps])


def estimated(model, stretch):
    return run(model, initial_state(model), paid_out(stretch))[1]


def root(function, low, high):
    """Where a falling function is 0, by bisection to the last digit."""
    for _ in range(64):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if function(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)


def left_over(before, after, bristle, slip, drag):
    """(E11) of one contact with tensions before and after it; perfectly plastic bristles [N]."""
    bound = (1.0 - exp(-MU * WRAP)) * max(before, after) + drag + 1e-9
    kept = min(max(bristle, -bound), bound)
    return after - before - min(max(kept + BRISTLES * slip, -bound), bound)


def balanced(material, bristle, drag, entering):
    """Tensions of the three elements after a sample: two bisections, one within the other [N]."""
    least = 1e-3
    m, f = material.tolist(), bristle.tolist()

    def tension(k, enters, leaves):
        return max(STIFFNESS * (LENGTH[k] / (m[k] + enters - leaves) - 1.0), 0.0)  # (E1), (E2)

    def first_of(second):
        def left(first):
            t = tension(0, entering, first), tension(1, first, second)
            return left_over(*t, f[0], first, drag[0])

        return root(left, second - m[1] + least, entering + m[0] - least)

    def left(second):
        t = tension(1, first_of(second), second), tension(2, second, 0.0)
        return left_over(*t, f[1], second, drag[1])

    second = root(left, least - m[2], entering + m[0] + m[1] - 3.0 * least)
    first = first_of(second)
    return [tension(0, entering, first), tension(1, first, second), tension(2, second, 0.0)]


@pytest.mark.parametrize("torque", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3, 0.1])
def test_tensions_are_those_of_two_bisections(torque):
    model, stretch = robot(torque), motion()[::5]
    state, slack = initial_state(model), 0
    for k, motor in enumerate(paid_out(stretch).motor_angle):
        before = state_views(model.sizes, state.values) if k else None
        if before is not None:
            material, bristle = before.material.copy(), before.bristle.copy()
        state, estimate = step(model, state, Sample((k + 1) * 25_000_000, motor, np.empty(0)))
        if before is None:
            continue
        entering = state_views(model.sizes, state.values).material.sum() - material.sum()
        drag = torque / RADIUS, 0.7 * torque / RADIUS
        expected = balanced(material, bristle, drag, entering)
        np.testing.assert_allclose(estimate.tension, expected, rtol=1e-9, atol=3e-8)
        slack += int(min(expected) <= 1e-6)
    assert 0.2 < slack / stretch.size < 0.9


@pytest.mark.parametrize("pulleys", [1, 2, 4, 7])
def test_no_bearing_torque_makes_a_slack_cable_slow(pulleys):
    iterations = []
    for torque in SCALES:
        model = robot(torque, pulleys)
        values, layout = estimated(model, motion()).values, model.layout
        assert not (values[:, layout.status].astype(int) & INVALID).any()
        assert values[:, layout.iterations].max() <= MOST
        iterations.append(values[:, layout.iterations].mean())
    assert max(iterations) < 1.5 * iterations[0] + 1.0


def test_tensions_change_as_little_as_the_bearing_torque():
    # what the least torques change stays below the accuracy of a solution; slack is where it was
    found = [estimated(robot(torque), motion()).tension for torque in SCALES[:9]]
    for torque, (one, other) in zip(SCALES[1:], pairwise(found), strict=False):
        assert np.abs(one - other).max() < 10.0 * torque / RADIUS + 1e-6
