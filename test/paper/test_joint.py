"""The load of a rolling joint against Lagrange's equations, its strands against virtual work."""

from dataclasses import astuple

import numpy as np
import pytest
import sympy

from cdrj_ros.simulation.load import make_load
from examples.paper.joint import Strands, kinetic_energy, potential_energy, rolling_load

NUMBERS = 0.23, 0.31, 0.043, 0.152, 9.78
"""Masses of joint and load [kg], R and L_d [m], gravity [m/s^2]."""
ANGLES = np.linspace(-0.7, 0.7, 29)
GENERATOR = np.random.default_rng(3)
SPEEDS, ACCELERATIONS = GENERATOR.normal(size=(2, ANGLES.size)) * [[3.0], [20.0]]


def lagrange():
    """Kinetic energy, potential energy and Lagrange's torque from positions alone."""
    t = sympy.Symbol("t")
    m_j, m_l, r, d, g = NUMBERS
    q = sympy.Function("q")(t)
    centre = 2 * r * sympy.Matrix([sympy.cos(q), sympy.sin(q)])
    load = centre + d * sympy.Matrix([sympy.cos(2 * q), sympy.sin(2 * q)])
    disc = m_j * r**2 / 2
    kinetic = (
        m_j * centre.diff(t).dot(centre.diff(t))
        + disc * (2 * q.diff(t)) ** 2
        + m_l * load.diff(t).dot(load.diff(t))
    ) / 2
    potential = m_j * g * centre[1] + m_l * g * load[1]
    lagrangian = kinetic - potential
    torque = lagrangian.diff(q.diff(t)).diff(t) - lagrangian.diff(q)
    a, v, x = sympy.symbols("a v x")
    plain = [
        one.subs(q.diff(t, 2), a).subs(q.diff(t), v).subs(q, x)
        for one in (kinetic, potential, torque)
    ]
    return np.array(sympy.lambdify((x, v, a), plain, "numpy")(ANGLES, SPEEDS, ACCELERATIONS))


def test_energies_and_torque_are_those_of_lagrange():
    kinetic, potential, torque = lagrange()
    load = rolling_load(*NUMBERS)
    np.testing.assert_allclose(kinetic_energy(load, ANGLES, SPEEDS), kinetic, rtol=1e-12)
    np.testing.assert_allclose(potential_energy(load, ANGLES), potential, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        load.torque(ANGLES, SPEEDS, ACCELERATIONS), torque, rtol=1e-11, atol=1e-13
    )


def test_the_load_of_the_rig_is_the_rolling_joint_of_the_source():
    assert astuple(rolling_load()) == pytest.approx(astuple(make_load("rolling")), rel=1e-12)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_amplification_keeps_the_work_and_gives_n_squared_the_stiffness(count):
    tension, travel = 17.0, 2e-3
    pull, stiffness, moved = Strands(count).output(tension, tension / travel, travel)
    assert pull * moved == pytest.approx(tension * travel)
    assert stiffness == pytest.approx(pull / moved) == count**2 * tension / travel


def test_torque_is_the_virtual_work_of_the_strands():
    strands, small = Strands(4, width=0.07), 1e-6
    upper, lower = 4 * 55.0, 4 * 31.0
    up, down = (
        (ahead - behind) / (2 * small) / strands.count
        for ahead, behind in zip(
            strands.lengths(ANGLES + small), strands.lengths(ANGLES - small), strict=True
        )
    )
    torque = strands.torque(ANGLES, upper, lower)
    np.testing.assert_allclose(torque, -(upper * up + lower * down), rtol=1e-8)
    shortened = strands.lengths(np.zeros(1))[0] - strands.lengths(ANGLES)[0]
    np.testing.assert_allclose(strands.angle(shortened), ANGLES, atol=1e-12)
