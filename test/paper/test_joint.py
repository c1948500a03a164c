"""The load of a rolling joint against Lagrange's equations and energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.simulation.load import make_load
from examples.paper.joint import RollingLoad

LOAD = RollingLoad(joint_mass=0.23, load_mass=0.31, rolling_radius=0.043, load_distance=0.152)
PRINTED = replace(LOAD, form="published")
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


@pytest.mark.parametrize("load", [LOAD, PRINTED], ids=lambda load: load.form)
def test_forward_dynamics_undo_inverse_dynamics(load: RollingLoad) -> None:
    torque = load.torque(ANGLES, SPEEDS, ACCELERATIONS)
    np.testing.assert_allclose(load.acceleration(ANGLES, SPEEDS, torque), ACCELERATIONS, rtol=1e-12)


def test_the_printed_dynamics_differ_by_the_loads_two_terms() -> None:
    r, d, m = LOAD.rolling_radius, LOAD.load_distance, LOAD.load_mass
    heavier = PRINTED.inertia(ANGLES) - LOAD.inertia(ANGLES)
    np.testing.assert_allclose(heavier, m * d * (d - 4 * r * np.cos(ANGLES)), atol=1e-15)
    centrifugal = PRINTED.centrifugal_torque(ANGLES, SPEEDS)
    np.testing.assert_allclose(centrifugal, 0.5 * LOAD.centrifugal_torque(ANGLES, SPEEDS))
    np.testing.assert_array_equal(PRINTED.weight_torque(ANGLES), LOAD.weight_torque(ANGLES))
    alone = replace(LOAD, load_mass=0.0)
    np.testing.assert_array_equal(
        alone.torque(ANGLES, SPEEDS, ACCELERATIONS),
        replace(alone, form="published").torque(ANGLES, SPEEDS, ACCELERATIONS),
    )


def test_an_unknown_form_is_refused() -> None:
    with pytest.raises(UsageError, match="form must be one of corrected, published"):
        RollingLoad(form="printed")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="rolling_radius must be positive, got -1"):
        RollingLoad(rolling_radius=-1.0)


def test_the_corrected_equations_are_those_of_the_simulated_load() -> None:
    own = make_load("rolling", 0.7).torque(ANGLES, SPEEDS, ACCELERATIONS)
    load = RollingLoad(load_mass=0.7)
    np.testing.assert_allclose(own, load.torque(ANGLES, SPEEDS, ACCELERATIONS), rtol=1e-12)
