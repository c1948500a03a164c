"""The load of a rolling joint against Lagrange's equations and energy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from examples.paper.joint import RollingLoad

LOAD = RollingLoad(joint_mass=0.23, load_mass=0.31, rolling_radius=0.043, load_distance=0.152)
ANGLES = np.linspace(-0.7, 0.7, 29)
GENERATOR = np.random.default_rng(3)
SPEEDS, ACCELERATIONS = GENERATOR.normal(size=(2, ANGLES.size)) * [[3.0], [20.0]]


@pytest.fixture(scope="module")
def symbolic() -> Callable[..., np.ndarray]:
    """Kinetic energy and Lagrange's torque from positions alone."""
    import sympy

    t, m_j, m_l, r, d, g = sympy.symbols("t m_j m_l r d g", positive=True)
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

    def plain(expression: sympy.Expr) -> sympy.Expr:
        return expression.subs(q.diff(t, 2), a).subs(q.diff(t), v).subs(q, x)

    numbers = sympy.lambdify(
        (x, v, a, m_j, m_l, r, d, g), [plain(e) for e in (kinetic, potential, torque)], "numpy"
    )

    def evaluate(load: RollingLoad) -> np.ndarray:
        return np.array(
            numbers(
                ANGLES, SPEEDS, ACCELERATIONS, load.joint_mass, load.load_mass,
                load.rolling_radius, load.load_distance, load.gravity,
            )
        )  # fmt: skip

    return evaluate


def test_energies_and_torque_are_those_of_lagrange(symbolic: Callable[..., np.ndarray]) -> None:
    kinetic, potential, torque = symbolic(LOAD)
    np.testing.assert_allclose(LOAD.kinetic_energy(ANGLES, SPEEDS), kinetic, rtol=1e-12)
    np.testing.assert_allclose(LOAD.potential_energy(ANGLES), potential, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        LOAD.torque(ANGLES, SPEEDS, ACCELERATIONS), torque, rtol=1e-11, atol=1e-13
    )
