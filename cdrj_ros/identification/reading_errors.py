"""Errors of the readings of angles, which make a fit choose soft cables: (I11).

The estimates are the noisier by errors of readings, such as the counts of encoders, the stiffer the
cables are.  Least squares lower that noise, too: they would choose cables that are too soft and
radii that are too small (errors in variables).  See docs/identification.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import sqrt
from typing import Final

import numpy as np

from cdrj_ros.estimation.conditioner import count_of
from cdrj_ros.estimation.estimator import Samples
from cdrj_ros.foundation.arrays import Series, Table, Vector
from cdrj_ros.identification.observations import Observations, samples_by
from cdrj_ros.identification.problem import Problem, residuals_of_one
from cdrj_ros.identification.residual_statistics import noise_stated
from cdrj_ros.robot.description import Joint, Motor, Robot, Sensor

WORTH: Final = 3.0
"""What all of that noise may be worth in the cost of a fit: as much as one number that deviates by
1.7 standard deviations of its prior, or as ten that deviate by half of one."""


def reading_variance(problem: Problem, coordinates: Vector) -> float:
    """(I11): variance of a residual with which errors of readings hardly count.

    Args:
        problem: the fit.
        coordinates: of the numbers, shape (p,).
    """
    model, generator = problem.model(coordinates), np.random.default_rng(0)
    changes = []
    for observed in problem.observations:
        samples = samples_by(model, observed)
        erring = _with_errors(model.robot, observed, samples, generator)
        there = replace(observed, samples=erring, offsets=model.robot.offsets)
        change = residuals_of_one(model, there) - residuals_of_one(model, observed)
        changes.append(change)
    return float(np.sum(np.concatenate(changes)[~noise_stated(problem)] ** 2)) / WORTH


def _with_errors(
    robot: Robot, observed: Observations, samples: Samples, generator: np.random.Generator
) -> Samples:
    """The samples with errors as large as those that they have, but others."""

    def erring(axes: Sequence[Motor | Joint], read: Mapping[str, Series], angles: Table) -> Table:
        size = [
            reading_error(axis.sensor, read[axis.name].value) if axis.name in read else 0.0
            for axis in axes
        ]
        return angles + np.array(size) * generator.standard_normal(angles.shape)

    recorded = observed.recorded
    return replace(
        samples,
        motor_angle=erring(robot.motors, recorded.motors, samples.motor_angle),
        joint_angle=erring(robot.joints, recorded.joints, samples.joint_angle),
    )


def reading_error(sensor: Sensor, values: Vector) -> float:
    """Standard deviation of an angle by the noise and the counts of its sensor [rad].

    Args:
        sensor: of the axis.
        values: its readings, which show a count that the robot file does not state.
    """
    count = max(sensor.resolution, count_of(values)) / sqrt(12.0)
    return abs(sensor.scale) * float(np.hypot(count, sensor.noise))
