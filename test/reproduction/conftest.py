"""One study for all tests of this folder: it takes some seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdrj_ros.reproduction.runs import Motion
from cdrj_ros.reproduction.study import Study, work
from cdrj_ros.robot.reader import load_robot

PROTOTYPE = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"


@pytest.fixture(scope="session")
def study() -> Study:
    shares: list[float] = []
    made = work(
        load_robot(PROTOTYPE), Motion(cycles=1, rate=250.0), cells=2, progress=shares.append
    )
    assert shares[-1] == 1.0
    assert min(shares) >= 0.0
    return made
