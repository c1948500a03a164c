"""Correction of a sensor's systematic error over its angle."""

from __future__ import annotations

import numpy as np
import pytest
from support.places import PROTOTYPE

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import parse_robot

TEXT = PROTOTYPE.read_text(encoding="utf-8")
EPOCH_NS = 1_700_000_000_000_000_000


def corrected(text: str) -> Robot:
    return parse_robot(
        TEXT.replace("  - name: elbow\n", f"  - name: elbow\n    correction: {text}\n")
    )


@pytest.fixture(scope="module")
def robot() -> Robot:
    return corrected("{angle_deg: [-30, 0, 30], value_deg: [1, 0, -0.5]}")


@pytest.mark.parametrize(
    ("reading_deg", "angle_deg"), [(-35.0, -34.0), (-30.0, -29.0), (-15.0, -14.5), (38.0, 37.5)]
)
def test_a_correction_is_linear_between_its_points_and_constant_beyond(
    robot: Robot, reading_deg: float, angle_deg: float
) -> None:
    stamps = EPOCH_NS + np.arange(2, dtype=np.int64) * 10_000_000
    flat = Series(stamps, stamps, np.zeros(2))
    reading = Series(stamps, stamps, np.full(2, np.radians(reading_deg)))
    (samples,) = condition(robot, {"winch": flat}, {"elbow": reading}).segments
    np.testing.assert_allclose(np.degrees(samples.joint_angle[:, 0]), angle_deg)


@pytest.mark.parametrize(
    ("text", "taught"),
    [
        ("{angle: [0, 1], value: [0]}", "at least 2"),
        ("{angle: [0, 1, 2], value: [0, 0]}", "must have 3 entries like angle, got 2"),
        ("{angle: [1, 0], value: [0, 0]}", "must increase"),
        ("{angle: [0, 0.1], value: [0.2, 0]}", "two readings would give one angle"),
        ("{angle: [0, 1]}", "value is missing"),
    ],
)
def test_an_impossible_correction_is_refused(text: str, taught: str) -> None:
    with pytest.raises(RobotFileError, match=taught):
        corrected(text)
