"""The prototype described by positions, compared with Table I and with its file of tables."""

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import load_robot

TABLE_ONE = [40.9, 105.4, 32.1, 57.7, None, 180.0, 90.0]
"""Wrap angles of pulleys 2 to 8 [deg]; that of pulley 6 varies from 0.6 to 78.5."""

LIMIT = np.radians(38.95)
W = 0.060
PULLEY_SIX = 0.0045


@pytest.fixture(scope="module")
def model():
    return prepare(load_robot(ROBOTS / "prototype_positions.yaml"))


def test_all_wrap_angles_agree_with_table_one_over_the_whole_range(model):
    for angle in np.linspace(-LIMIT, LIMIT, 201):
        wraps = np.degrees(shape_at(model, np.array([angle])).wrap).reshape(2, 7)
        share = (angle + LIMIT) / (2.0 * LIMIT)
        for cable, passed in ((0, share), (1, 1.0 - share)):
            expected = [one if one is not None else 0.6 + 77.9 * passed for one in TABLE_ONE]
            np.testing.assert_allclose(wraps[cable], expected, atol=0.05)


def test_the_strands_across_the_joint_are_those_of_equation_two(model):
    arcs = 0.5 * PULLEY_SIX * np.pi
    for angle in np.linspace(-LIMIT, LIMIT, 41):
        shape = shape_at(model, np.array([angle]))
        length, wrap = shape.length.reshape(2, 8), shape.wrap.reshape(2, 7)
        for cable, sign in ((0, -1.0), (1, 1.0)):
            strand = 0.080 + sign * W * np.sin(angle)
            half = 0.5 * PULLEY_SIX * wrap[cable, 4]
            assert length[cable, 5] - half - arcs == pytest.approx(strand, abs=1e-9)
            assert length[cable, 6] - arcs - 0.5 * arcs == pytest.approx(strand, abs=1e-9)
