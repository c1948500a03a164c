"""K of (28): the derivative of the forces, its symmetry, rigid motion, patch test, the solver."""

from __future__ import annotations

import numpy as np
import pytest
from support.core_laws import solve_cable

from cdrj_ros._core import Law, element_tension, tolerance
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.cable_records import CONTACT, SEGMENT
from cdrj_ros.model.elasticity import Elasticity
from examples.paper.stiffness import (
    Stiffness,
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

    def __init__(self, seed: int, nodes: int = 6, dimensions: int = 3) -> None:
        generator = np.random.default_rng(seed)
        steps = generator.normal(size=(nodes, dimensions)) * 0.1
        self.position = np.cumsum(steps, axis=0)
        self.tension = generator.uniform(5.0, 60.0, nodes - 1)
        self.length = np.linalg.norm(np.diff(self.position, axis=0), axis=1)
        self.material = self.length / (1.0 + self.tension / EA)
        self.transmission = generator.uniform(0.6, 0.98, nodes - 2)
        self.direction = generator.choice([-1.0, 1.0], nodes - 2)
        self.shape = self.position.shape

    def forces(self, unknowns: np.ndarray, eta: np.ndarray, exact: bool = True) -> np.ndarray:
        """Pull on every node and imbalance at every pulley, nonlinear in all unknowns."""
        n, d = self.shape
        x = self.position + unknowns[: n * d].reshape(n, d)
        slip = np.concatenate([[0.0], unknowns[n * d :], [0.0]])
        chord = np.diff(x, axis=0)
        length = np.linalg.norm(chord, axis=1)
        if exact:
            material = self.material - np.diff(slip)
            tension = np.array(
                [element_tension(LINEAR, a, b) for a, b in zip(length, material, strict=True)]
            )
        else:
            k = nominal_stiffness(EA, self.length)
            tension = linear_tension(self.tension, k, length - self.length, slip)
        pull = tension[:, None] * chord / length[:, None]
        force = np.zeros((n, d))
        force[:-1] += pull
        force[1:] -= pull
        return np.concatenate([force.ravel(), imbalance(tension, eta, self.direction)])

    def matrix(
        self, eta: np.ndarray | None = None, exact: bool = True, geometric: bool = True
    ) -> Stiffness:
        by_length, by_material = exact_stiffness(LINEAR, self.length, self.tension)
        if not exact:
            by_length = by_material = nominal_stiffness(EA, self.length)
        return stiffness_matrix(
            self.position, self.tension, by_length, by_material, eta, self.direction, geometric
        )


def differences(chain: Chain, eta: np.ndarray, exact: bool) -> np.ndarray:
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
def test_the_matrix_is_the_negative_derivative_of_forces_and_imbalances(
    seed: int, dimensions: int, exact: bool
) -> None:
    chain = Chain(seed, dimensions=dimensions)
    matrix = chain.matrix(chain.transmission, exact).matrix
    expected = -differences(chain, chain.transmission, exact)
    np.testing.assert_allclose(matrix, expected, atol=1e-7 * np.abs(expected).max())


def test_the_matrix_is_symmetric_exactly_where_every_transmission_is_one() -> None:
    chain = Chain(4)
    matrix = chain.matrix(exact=False).matrix
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9)
    for pulley in range(chain.shape[0] - 2):
        eta = np.ones(chain.shape[0] - 2)
        eta[pulley] = 0.97
        rubbing = chain.matrix(eta, exact=False)
        lopsided = np.abs(rubbing.matrix - rubbing.matrix.T).max()
        assert lopsided > 0.01 * nominal_stiffness(EA, chain.length).min()
        np.testing.assert_array_equal(rubbing.node_by_node, chain.matrix(exact=False).node_by_node)


def test_a_rotation_turns_the_forces_and_gives_none() -> None:
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


def test_a_frictionless_cable_condenses_to_one_spring() -> None:
    # both ends of a straight cable: EA over its whole length, however many pulleys lie between
    straight = np.outer([0.0, 0.3, 0.4, 0.9], [1.0, 0.0, 0.0])
    length = np.array([0.3, 0.1, 0.5])
    blocks = stiffness_matrix(straight, np.full(3, 10.0), nominal_stiffness(EA, length))
    condensed = blocks.condensed()
    assert condensed[0, 0] == pytest.approx(EA / 0.9)
    assert condensed[9, 0] == pytest.approx(-EA / 0.9)
    np.testing.assert_allclose(condensed[3:9:3], 0.0, atol=1e-9)


def test_a_slack_element_exerts_no_force_and_has_no_stiffness() -> None:
    chain = Chain(12)
    chain.tension[2] = 0.0
    blocks = chain.matrix(exact=False)
    alone = Chain(12)
    alone.position = alone.position[:3]
    alone.shape = alone.position.shape
    for name in ("length", "tension"):
        setattr(alone, name, getattr(alone, name)[:2])
    alone.direction = alone.direction[:1]
    part = alone.matrix(exact=False)
    np.testing.assert_allclose(blocks.node_by_node[:9, :9], part.node_by_node)
    tension = linear_tension(np.array([1.0]), np.array([1e3]), np.array([-0.1]), np.zeros(2))
    assert tension[0] == 0.0
    chain.tension[:] = 0.0
    with pytest.raises(UsageError, match="slack elements leave the slips undetermined"):
        chain.matrix().slips(np.zeros(chain.shape))


def solved_chain(
    length: np.ndarray, material: np.ndarray, first_slip: float
) -> tuple[np.ndarray, np.ndarray]:
    """Slips and tensions of the frictionless chain, by the estimator's solver."""
    count = length.size - 1
    segments, contacts = np.zeros(count + 1, SEGMENT), np.zeros(count, CONTACT)
    segments["length_before"] = segments["length"] = length
    segments["material_before"] = material
    _, residual = solve_cable(LINEAR, segments, contacts, first_slip, 0.0, Law.none, 1e-3)
    assert residual <= tolerance(LINEAR)
    return contacts["flux"].copy(), segments["tension"].copy()


def test_slips_of_the_solver_follow_the_slip_block() -> None:
    # wind in s_1 of a frictionless cable: K_ss S = k_1 s_1 in the first row
    length = np.array([0.2, 0.1, 0.15, 0.08, 0.05])
    tension = np.full(5, 30.0)
    material = length / (1.0 + tension / EA)
    straight = np.outer(np.concatenate([[0.0], np.cumsum(length)]), [1.0, 0.0])
    by_length, by_material = exact_stiffness(LINEAR, length, tension)
    block = stiffness_matrix(straight, tension, by_length, by_material).slip_by_slip
    small = 1e-5
    ahead, _ = solved_chain(length, material, small)
    back, _ = solved_chain(length, material, -small)
    driven = np.zeros(4)
    driven[0] = by_material[0]
    np.testing.assert_allclose(
        (ahead - back) / (2 * small), np.linalg.solve(block, driven), rtol=1e-6
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"position": np.zeros((3, 4))}, r"shape \(n, 2\) or \(n, 3\), got \(3, 4\)"),
        ({"position": np.zeros((3, 3))}, "neighbouring nodes coincide"),
        ({"tension": np.ones(3)}, r"tension must have the shape \(2,\), got \(3,\)"),
        ({"tension": np.array([1.0, -1.0])}, "tension must not be negative"),
        ({"transmission": np.array([1.2])}, r"transmission must be in \(0, 1\]"),
        ({"direction": np.array([0.5])}, r"direction must be \+1 or -1"),
    ],
)
def test_what_no_cable_can_be_is_refused(changed: dict[str, np.ndarray], message: str) -> None:
    given = {
        "position": np.eye(3),
        "tension": np.ones(2),
        "by_length": np.ones(2),
        "transmission": np.ones(1),
        "direction": np.ones(1),
    }
    stiffness_matrix(**given)
    with pytest.raises(UsageError, match=message):
        stiffness_matrix(**(given | changed))
