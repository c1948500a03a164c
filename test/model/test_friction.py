"""Friction of one pulley: the source's numbers and equations, and properties for any input."""

from math import pi, radians

import numpy as np
import pytest

from cdrj_ros._core import Law, Stribeck, blended_loss, cell_loss, friction_force

# Tables I and II of the source, pulleys 2 to 8; the wrap of pulley 6 is its largest.
WRAPS = tuple(map(radians, (40.9, 105.4, 32.1, 57.7, 78.5, 180.0, 90.0)))
BEARING_DIAMETERS = (0.010, 0.010, 0.010, 0.006, 0.005, 0.005, 0.005)
RADII = (0.011, 0.011, 0.011, 0.0065, 0.0045, 0.0045, 0.0045)
MU_C, MU_S, BEARING_FRICTION = 0.15, 0.20, 0.01
BEARING_RATIOS = tuple(
    BEARING_FRICTION * d / r for d, r in zip(BEARING_DIAMETERS, RADII, strict=True)
)
TABLE = tuple(zip(WRAPS, BEARING_RATIOS, strict=True))

# Typical bristle stiffness and forces: sigma0 g / ... keeps slips of some micrometres.
STIFFNESS, BOUND = 1e6, 4.0

LAW = Law.__members__


def losses(rho, beta, bearing_ratio=0.0, mu_c=MU_C, mu_s=MU_S):
    """1 - eta at high slip speed, and the further loss at rest."""
    return blended_loss(rho, mu_c, mu_s, beta, bearing_ratio, Stribeck.printed)


def test_bearing_transmission_of_the_sources_tables():
    eta = [1.0 - losses(0.0, *row)[0] for row in TABLE]
    expected = [0.99367, 0.98564, 0.99499, 0.99113, 0.98604, 0.97802, 0.98441]
    np.testing.assert_allclose(eta, expected, atol=5e-6)
    assert np.prod(eta) == pytest.approx(0.9169, abs=5e-5)


def test_sliding_transmission_of_the_sources_tables():
    at_rest = [0.8646, 0.6785, 0.8925, 0.8131, 0.7523, 0.4990, 0.7201]
    fast = [0.8985, 0.7589, 0.9194, 0.8598, 0.8142, 0.6242, 0.7901]
    np.testing.assert_allclose([1.0 - sum(losses(1.0, b)) for b in WRAPS], at_rest, atol=5.1e-5)
    np.testing.assert_allclose([1.0 - losses(1.0, b)[0] for b in WRAPS], fast, atol=5.1e-5)


def test_printed_static_friction_never_makes_the_transmission_negative():
    # (35) as printed would leave nothing to transmit: a loss of 0.27 mu_s / mu_c = 1.08
    for rho in (1.0, 0.95):
        kinetic, static = losses(rho, pi, 0.01, mu_c=0.1, mu_s=0.4)
        assert static >= 0.0
        assert 1.0 - kinetic - static >= 0.001 * (1.0 - 1e-9)
    for wrap in (pi, 4 * pi, 20 * pi):
        kinetic, static = cell_loss(*losses(1.0, wrap, mu_c=2.0, mu_s=2.0), 0.125)
        assert 1.0 - kinetic - static > 0.0
        assert static >= 0.0


LAWS_AND_BREAKAWAYS = [
    (LAW["lugre"], 1.0),
    (LAW["euler"], 1.0),
    (LAW["steady"], 1.0),
    (LAW["elastoplastic"], 1.0),
    (LAW["elastoplastic"], 0.7),
    (LAW["elastoplastic"], 0.0),
]


def _wrong_derivatives(law, breakaway, befores):
    """Where the derivatives by slip and bound differ from central differences."""
    # slips: elastic, around and through the knee, far, in both directions
    slips = [-6.0, -2.1, -0.9, -0.33, -0.051, 0.047, 0.31, 0.88, 1.9, 5.0]
    little_slip, little = 1e-6 * BOUND / STIFFNESS, 1e-6 * BOUND
    wrong = []
    for before in befores:
        for slip in slips:

            def force(x, g, before=before, slip=slip):
                at = slip * BOUND / STIFFNESS + x
                return friction_force(law, before * BOUND, at, STIFFNESS, BOUND + g, breakaway)[0]

            _, by_slip, by_bound = friction_force(
                law, before * BOUND, slip * BOUND / STIFFNESS, STIFFNESS, BOUND, breakaway
            )
            slope = (force(little_slip, 0.0) - force(-little_slip, 0.0)) / (2 * little_slip)
            shift = (force(0.0, little) - force(0.0, -little)) / (2 * little)
            if abs(by_slip - slope) > 1e-6 * STIFFNESS or abs(by_bound - shift) > 1e-6:
                wrong.append((before, slip, (by_slip, slope), (by_bound, shift)))
    return wrong


@pytest.mark.parametrize(("law", "breakaway"), LAWS_AND_BREAKAWAYS)
def test_derivatives_equal_differences_on_every_branch(law, breakaway):
    befores = [-0.99, -0.8, -0.3, 0.0, 0.31, 0.72, 0.97]
    assert _wrong_derivatives(law, breakaway, befores) == []


@pytest.mark.parametrize(("law", "breakaway"), LAWS_AND_BREAKAWAYS)
def test_the_force_is_continuous_and_never_falls_with_the_slip(law, breakaway):
    slips = np.linspace(-3.0, 3.0, 4001) * BOUND / STIFFNESS
    for before in np.array([-1.4, -1.0, -0.75, 0.0, 0.5, 1.0, 1.1]) * BOUND:
        forces = np.array(
            [friction_force(law, before, x, STIFFNESS, BOUND, breakaway)[0] for x in slips]
        )
        rise = np.diff(forces)
        steepest = STIFFNESS * (1.0 + max(1.0, abs(before) / BOUND))
        if abs(before) > BOUND:  # a force beyond the bound returns towards it for slip either way
            assert np.all(np.abs(rise) <= steepest * (slips[1] - slips[0]))
            continue
        assert np.all(rise >= -1e-12)
        assert np.all(rise <= steepest * (slips[1] - slips[0]) * (1.0 + 1e-9))


def _minor_loops(law, breakaway, loops):
    """Force at the beginning and after some small loops amid pre-sliding."""
    force = begin = 0.6 * BOUND
    for _ in range(loops):
        for slip in (-3e-7, 3e-7):
            force = friction_force(law, force, slip, STIFFNESS, BOUND, breakaway)[0]
    return begin, force


def test_minor_loops_close_exactly_where_lugre_creeps():
    for law in (LAW["euler"], LAW["steady"], LAW["elastoplastic"]):
        begin, end = _minor_loops(law, 1.0, 1000)
        assert end == pytest.approx(begin, abs=1e-11)
    begin, end = _minor_loops(LAW["elastoplastic"], 0.7, 1000)
    assert end == pytest.approx(begin, abs=1e-11), "below break-away"
    begin, end = _minor_loops(LAW["lugre"], 1.0, 1000)
    assert end < 0.1 * begin, "the source's law loses its force under ripple"
