"""K of (28): the derivative of the forces, a rotation of the whole, refusals."""

import numpy as np
import pytest

from cdrj_ros.model.laws import Elasticity
from examples.paper.stiffness import (
    exact_stiffness,
    imbalance,
    linear_tension,
    nominal_stiffness,
    stiffness_matrix,
)

EA = 6283.0
LINEAR = Elasticity(EA)


class Chain:
    """A taut cable over point-like pulleys in space, in no particular shape."""

    def __init__(self, seed, nodes=6, dimensions=3):
        generator = np.random.default_rng(seed)
        steps = generator.normal(size=(nodes, dimensions)) * 0.1
        self.position = np.cumsum(steps, axis=0)
        self.tension = generator.uniform(5.0, 60.0, nodes - 1)
        self.length = np.linalg.norm(np.diff(self.position, axis=0), axis=1)
        self.material = self.length / (1.0 + self.tension / EA)
        self.transmission = generator.uniform(0.6, 0.98, nodes - 2)
        self.direction = generator.choice([-1.0, 1.0], nodes - 2)
        self.shape = self.position.shape

    def forces(self, unknowns, eta, exact=True):
        """Pull on every node and imbalance at every pulley, nonlinear in all unknowns."""
        n, d = self.shape
        x = self.position + unknowns[: n * d].reshape(n, d)
        slip = np.concatenate([[0.0], unknowns[n * d :], [0.0]])
        chord = np.diff(x, axis=0)
        length = np.linalg.norm(chord, axis=1)
        if exact:
            material = self.material - np.diff(slip)
            tension = EA * (length / material - 1.0)
        else:
            k = nominal_stiffness(EA, self.length)
            tension = linear_tension(self.tension, k, length - self.length, slip)
        pull = tension[:, None] * chord / length[:, None]
        force = np.zeros((n, d))
        force[:-1] += pull
        force[1:] -= pull
        return np.concatenate([force.ravel(), imbalance(tension, eta, self.direction)])

    def matrix(self, eta, exact=True, geometric=True):
        by_length, by_material = exact_stiffness(LINEAR, self.length, self.tension)
        if not exact:
            by_length = by_material = nominal_stiffness(EA, self.length)
        return stiffness_matrix(
            self.position, self.tension, by_length, by_material, eta, self.direction, geometric
        )


def differences(chain, eta, exact):
    n, d = chain.shape
    small = 1e-7
    columns = [
        (chain.forces(small * unit, eta, exact) - chain.forces(-small * unit, eta, exact))
        / (2 * small)
        for unit in np.eye(n * d + n - 2)
    ]
    return np.column_stack(columns)


@pytest.mark.parametrize("exact", [True, False], ids=["exact", "linear"])
@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_the_matrix_is_the_negative_derivative_of_forces_and_imbalances(seed, dimensions, exact):
    chain = Chain(seed, dimensions=dimensions)
    matrix = chain.matrix(chain.transmission, exact).matrix
    expected = -differences(chain, chain.transmission, exact)
    np.testing.assert_allclose(matrix, expected, atol=1e-7 * np.abs(expected).max())


def test_a_rotation_turns_the_forces_and_gives_none():
    chain = Chain(8)
    n, _ = chain.shape
    spin = np.array([0.3, -0.7, 0.5])
    turned = np.cross(spin, chain.position)
    force = chain.forces(np.zeros(4 * n - 2), chain.transmission)[: 3 * n].reshape(n, 3)
    blocks = chain.matrix(chain.transmission)
    pull = blocks.node_by_node @ turned.ravel()
    np.testing.assert_allclose(pull, -np.cross(spin, force).ravel(), atol=1e-9)
    np.testing.assert_allclose(blocks.slip_by_node @ turned.ravel(), 0.0, atol=1e-9)
    # without the geometric part a rotation causes no force at all
    still = chain.matrix(chain.transmission, geometric=False)
    np.testing.assert_allclose(still.node_by_node @ turned.ravel(), 0.0, atol=1e-9)
