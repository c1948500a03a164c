"""Keep the tests' ROS traffic to themselves.

Set before anything imports rclpy, and inherited by every process a test starts: a domain of this
run's own, and no discovery beyond this machine. Two runs side by side do not hear each other.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from cdrj_ros.estimation.estimator import Samples
    from cdrj_ros.model.plan import Model

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

SAMPLE = Path(__file__).parents[1] / "bags" / "prototype_preload_36_26"


@pytest.fixture(scope="session")
def recorded() -> Callable[[Model, int], Samples]:
    """Angles of the sample recording, six cycles at 1.5 kHz, of which every so many-th is kept."""
    from cdrj_ros.bag import Topics
    from cdrj_ros.estimation.estimator import Samples
    from cdrj_ros.validation import condition_recording, read_inputs

    def every(model: Model, step: int) -> Samples:
        recording = read_inputs(str(SAMPLE), Topics(), model)
        samples = condition_recording(model, recording).segments[0]
        return Samples(*(column[::step].copy() for column in vars(samples).values()))

    return every
