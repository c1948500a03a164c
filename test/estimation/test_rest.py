"""Whether a robot is considered at rest."""

import numpy as np
from support.places import ROBOTS

from cdrj_ros.estimation.changes import REST_STEP_NS, RestWatch
from cdrj_ros.estimation.estimator import Sample
from cdrj_ros.model.prepared import load_model


def test_a_reading_that_alternates_between_three_counts_is_at_rest() -> None:
    robot = load_model(str(ROBOTS / "prototype.yaml")).robot
    count = robot.motors[0].sensor.resolution * abs(robot.motors[0].sensor.scale)
    assert count > 0.0
    for middle in range(1000, 1100):
        for most, is_at_rest in ((1, True), (2, False)):
            watch = RestWatch()
            for k in range(32):
                motor = np.array([count * (middle + (-1) ** k * most)])
                watch.add(Sample(k * REST_STEP_NS, motor, np.zeros(len(robot.joints))))
            assert (watch.in_motion(robot) == "") == is_at_rest
