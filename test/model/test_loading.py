"""Finding a robot file by its name."""

from __future__ import annotations

import pytest

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.model.loading import robot_path


def test_an_installed_robot_is_found_by_its_name() -> None:
    assert robot_path("prototype").name == "prototype.yaml"


def test_a_misspelt_name_is_answered_with_the_nearest_one() -> None:
    with pytest.raises(RobotFileError, match=r"did you mean prototype[?]"):
        robot_path("protoype")
    with pytest.raises(RobotFileError, match=r"is installed$"):
        robot_path("xyzzy")
