"""Vectors are compared by the length of their difference and by the angle between them."""

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.evaluation.channels import BagComparison, Channel
from cdrj_ros.evaluation.metrics import (
    DIRECTION_SHARE,
    ChannelError,
    channel_error,
    mean_over_channels,
    pooled_errors,
)

NAME = "force_vector/upper/3"
RANDOM = np.random.default_rng(11)
FORCE = RANDOM.normal(0.0, 30.0, (400, 3))
STAMPS = np.arange(400, dtype=np.int64) * 1_000_000


def perpendicular(vectors):
    """Unit vectors at right angles to these, in random directions."""
    across = np.cross(vectors, np.random.default_rng(1).normal(size=vectors.shape))
    return across / np.linalg.norm(across, axis=1)[:, None]


def turned(vectors, degrees):
    """The vectors, each turned by the angle about an axis at right angles to it."""
    angle, length = np.radians(degrees), np.linalg.norm(vectors, axis=1)[:, None]
    return np.cos(angle) * vectors + np.sin(angle) * length * perpendicular(vectors)


@pytest.mark.parametrize("degrees", [1e-5, 0.3, 8.0, 90.0, 173.0, 180.0])
def test_a_turned_force_has_that_angle_and_the_length_of_its_chord(degrees):
    error = channel_error(turned(FORCE, degrees), FORCE)
    chord = 2.0 * np.sin(np.radians(degrees) / 2.0)
    assert error.mean_direction_error_deg == pytest.approx(degrees, rel=1e-7)
    assert error.max_direction_error_deg == pytest.approx(degrees, rel=1e-7)
    assert error.mean_relative_error == pytest.approx(chord, rel=1e-7)
    longest = np.linalg.norm(FORCE, axis=1).max()
    assert error.max_abs_error == pytest.approx(chord * longest, rel=1e-7)
    larger = channel_error(1.3 * FORCE, FORCE)
    assert larger.mean_relative_error == pytest.approx(0.3)
    assert larger.max_direction_error_deg == pytest.approx(0.0, abs=1e-9)


def test_figures_agree_with_those_computed_by_hand():
    # differences (3, 4, 0) and 0; deviations of the reference from its mean are ±(5, 0, 0)
    error = channel_error(
        np.array([[3.0, 4.0, 0.0], [10.0, 0.0, 0.0]]), np.array([[0.0] * 3, [10.0, 0.0, 0.0]])
    )
    assert (error.n, error.mean_abs_error, error.max_abs_error) == (2, 2.5, 5.0)
    assert error.rmse == pytest.approx(np.sqrt(12.5))
    assert error.mean_relative_error == 0.0  # of the one that is not zero
    assert error.r2 == pytest.approx(1.0 - 25.0 / 50.0)
    assert error.mean_direction_error_deg == 0.0


def test_forces_too_small_for_a_direction_have_none():
    reference = np.array([[100.0, 0.0, 0.0]] * 4)
    estimate = turned(reference, 10.0)
    small = 100.0 * DIRECTION_SHARE * 0.99
    reference[1] = [0.0, small, 0.0]
    estimate[2] = [0.0, small, 0.0]
    estimate[3] = 0.0
    error = channel_error(estimate, reference)
    assert error.max_direction_error_deg == pytest.approx(10.0)
    assert error.n == 4
    assert error.max_abs_error >= 100.0  # they count in the error of the vector
    nothing = channel_error(np.zeros((3, 3)), np.zeros((3, 3)))
    assert nothing.mean_direction_error_deg is None
    assert nothing.max_direction_error_deg is None


def _bag(estimate, reference):
    unknown = np.full(len(reference), np.nan)
    channel = Channel(NAME, "N", STAMPS[: len(reference)], estimate, reference, unknown, "")
    return BagComparison("bag", 1.0, (channel,))


def test_recordings_are_pooled_and_channels_summed_up():
    pooled = pooled_errors([_bag(turned(FORCE, 2.0), FORCE), _bag(turned(FORCE, 6.0), FORCE)])
    assert pooled[NAME].n == 800
    assert pooled[NAME].mean_direction_error_deg == pytest.approx(4.0)
    assert pooled[NAME].max_direction_error_deg == pytest.approx(6.0)
    scalar = ChannelError(5, 1.0, 0.1, 1.0, 2.0, 0.9)
    other = replace(pooled[NAME], mean_direction_error_deg=2.0, max_direction_error_deg=9.0)
    overall = mean_over_channels([pooled[NAME], other, scalar])
    assert overall.mean_direction_error_deg == pytest.approx(3.0)
    assert overall.max_direction_error_deg == 9.0
