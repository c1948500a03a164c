"""The angle of a joint without encoder minimises (M1) and (M2) of docs/model.md.

Both sums are written out here and minimised without derivatives, from the outputs of the sample
before: its state, the angle and, without an ensemble, the angle's variance P.
"""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from support.motor_alone import NOISE, motion, only_measured, truth_of, without_encoder

from cdrj_ros import _core
from cdrj_ros.estimation.encoderless import EncoderlessEstimator
from cdrj_ros.model.prepared import shape_at
from cdrj_ros.robot.description import Winch

DT, PERSISTENCE = 0.005, 0.05
SAMPLES = 200


class Before(NamedTuple):
    """Results and reading of the sample before."""

    angle: float
    variance: float
    load: float
    motor: float


def least(cost, near, within):
    """Where a cost is least, near an angle."""
    bounds = (near - within, near + within)
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    return float(found.x)


def squared_slope(values, at, step):
    """Square of the derivative of a function."""
    return float(((values(at + step) - values(at - step)) / (2.0 * step)) ** 2)


class Sample:
    """One sample: what is known before it, and the robot that any angle would give."""

    def __init__(self, model, state, motor, before):
        self.model, self.state, self.motor, self.before = model, state, motor, before
        joint = model.robot.joints[0]
        self.span, self.drift = joint.upper - joint.lower, joint.load_drift
        self.step = 1e-4 * self.span
        self._robot = _core.Robot(model.topology, model.constants)

    def _estimate(self, angle):
        before = _core.State(0, self.state)
        return self._robot.step(before, round(DT * 1e9), self.motor, np.array([angle]))[1]

    def effort(self, angle):
        return float(self._estimate(angle)[self.model.layout.motor_effort][0])

    def load(self, angle):
        return float(self._estimate(angle)[self.model.layout.joint_effort][0])

    def imposed(self):
        """Angle to which the cables turn the joint while their elongation stays the same."""
        arms = shape_at(self.model, np.array([self.before.angle])).lever_arm[:, 0]
        turned, at = float(self.motor[0]) - self.before.motor, 0
        taken, slopes = [], []
        for cable in self.model.robot.cables:
            own = arms[at : at + len(cable.element_names)]
            at += own.size
            ends = [node for node in (cable.nodes[0], cable.nodes[-1]) if isinstance(node, Winch)]
            taken.append(sum(node.radius * node.winding * turned for node in ends))
            slopes.append(float(own.sum()))
        return self.before.angle - float(np.dot(slopes, taken) / np.dot(slopes, slopes))

    def predicted(self):
        """Angle by (M1) and its variance."""
        q0, wander = self.imposed(), (0.04 * self.span) ** 2 * DT
        if self.drift == 0.0:
            return q0, self.before.variance + wander
        per_load = self.drift**2 * DT

        def cost(q):
            return (q - q0) ** 2 / wander + (self.load(q) - self.before.load) ** 2 / per_load

        q1 = least(cost, q0, 300 * self.step)
        widening = 1.0 / (1.0 / wander + squared_slope(self.load, q1, self.step) / per_load)
        return q1, self.before.variance + widening

    def corrected(self, measured):
        """Angle by (M2) and its variance."""
        q1, variance = self.predicted()
        variance = min(variance, self.span**2 / 12.0)
        weight = DT / (NOISE**2 * PERSISTENCE)

        def cost(q):
            return (q - q1) ** 2 / variance + weight * (measured - self.effort(q)) ** 2

        q = least(cost, q1, 300 * self.step)
        return q, 1.0 / (1.0 / variance + weight * squared_slope(self.effort, q, self.step))


@pytest.mark.parametrize("load_drift", [0.0, 0.01])
def test_the_angle_of_every_sample_minimises_both_sums(load_drift):
    model = without_encoder("prototype", "elbow", load_drift=load_drift)
    samples = motion(model, SAMPLES)
    _, efforts = truth_of(model, samples)
    read = only_measured(model, samples)
    estimator = EncoderlessEstimator(model, members=0)
    before = None
    for k in range(SAMPLES):
        state = estimator.core.state
        found = estimator.run(read.part(slice(k, k + 1)), efforts[k : k + 1])
        angle, stddev = float(found.angles.value[0, 0]), float(found.angles.stddev[0, 0])
        if before is not None:
            sample = Sample(model, state, read.motor_angle[k], before)
            wanted, variance = sample.corrected(efforts[k, 0])
            assert abs(angle - wanted) < 0.02 * sample.step
            assert stddev**2 == pytest.approx(variance, rel=0.05)  # one-sided differences
        load = float(found.values[0, model.layout.joint_effort][0])
        before = Before(angle, stddev**2, load, float(read.motor_angle[k, 0]))
