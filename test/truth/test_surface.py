"""Laws of the balance of a cable on surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from truth.surface import Cable, Contact, Course, State, solve

EA = 1e4
RADIUS = 0.02
CELL = RADIUS * np.radians(1.5)


def course(wound: float, wrap: float = 2.0, first: float = 0.3 * CELL) -> Course:
    """A drum, a round body and a fixed end; ``wound`` [m] is on the drum."""
    arc = RADIUS * wrap
    return Course(
        np.array([0.2, 0.3]), np.array([first]), np.array([first + arc]), np.array([wrap]),
        np.array([True]), np.array([wound, 0.0]),
    )  # fmt: skip


def pulled(cable: Cable, wound: np.ndarray) -> list[State]:
    return list(solve(cable, map(course, wound)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_where_all_slips_the_tensions_have_the_ratio_of_the_capstan(sign: float) -> None:
    cable = Cable(EA, 50.0, (Contact(0.2, CELL),))
    last = pulled(cable, sign * np.linspace(0.0, 0.001, 50))[-1].tension(cable)
    assert last[0] / last[1] == pytest.approx(np.exp(sign * 0.2 * 2.0), rel=1e-9)


def test_cable_that_is_laid_and_lifted_on_a_rough_body_keeps_its_strain_meanwhile() -> None:
    # Both ends stand still in the sense of the surface: the free span shortens as the arc grows.
    cable = Cable(EA, 50.0, (Contact(0.2, CELL),))
    turned = np.concatenate([np.linspace(0.0, 1.0, 300), np.linspace(1.0, 0.0, 300)])
    courses = [
        Course(
            np.array([0.2, 0.3 - RADIUS * more]), np.array([0.1]),
            np.array([0.1 + RADIUS * (1.0 + more)]), np.array([1.0 + more]), np.array([True]),
            np.zeros(2),
        )
        for more in turned
    ]  # fmt: skip
    for state in solve(cable, courses):
        np.testing.assert_allclose(state.tension(cable), 50.0, rtol=1e-9)
        assert state.slip.size == 0 or np.abs(state.slip).max() < 1e-12


def test_cable_wound_onto_a_drum_comes_back_as_it_was_laid() -> None:
    cable = Cable(EA, 50.0, (Contact(0.2, CELL),))
    wound = np.concatenate([np.linspace(0.0, 0.02, 400), np.linspace(0.02, 0.0, 400)])
    give = np.concatenate([np.linspace(0.0, 0.02, 400), np.linspace(0.02, 0.0, 400)])
    states = list(
        solve(
            cable,
            (
                Course(
                    np.array([0.2, 0.3 - g]), np.array([0.0]), np.array([0.04]), np.array([2.0]),
                    np.array([True]), np.array([w, 0.0]),
                )
                for w, g in zip(wound, give, strict=True)
            ),
        )
    )  # fmt: skip
    material = [np.diff(state.ends)[0] for state in states]
    assert states[-1].drums[0].shape == (1, 2)
    assert material[-1] == pytest.approx(material[0], rel=1e-12)


def test_finer_cells_and_shorter_steps_leave_the_tensions_as_they_are() -> None:
    def swept(cell: float, steps: int) -> np.ndarray:
        phase = np.linspace(0.0, 4.0 * np.pi, steps + 1)
        contact = Contact(0.2, RADIUS * np.radians(cell))
        cable = Cable(EA, 50.0, (contact,))
        courses = (
            Course(
                np.array([0.2, 0.3 - RADIUS * more]), np.array([0.0]),
                np.array([RADIUS * (1.2 + more)]), np.array([1.2 + more]), np.array([True]),
                np.array([wound, 0.0]),
            )
            for more, wound in zip(0.5 * np.sin(phase), 0.0006 * np.sin(1.5 * phase), strict=True)
        )  # fmt: skip
        states = list(solve(cable, courses))
        return np.stack([s.tension(cable) for s in states[:: steps // 200]])

    coarse, fine = swept(1.5, 400), swept(0.5, 1600)
    assert np.mean(np.abs(coarse / fine - 1.0)) < 1e-4
