"""The ensemble is what docs/estimation.md describes, with robots stepped one by one."""

import numpy as np
import pytest

from cdrj_ros import _core
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import load_model

MEMBERS = 8
COUNT = 60
APART_NS = 2_000_000
CORNER = 25
"""Sample at which all axes turn back."""


def _motion(model):
    robot = model.robot
    sample = np.arange(COUNT)
    swing = 0.01 * np.minimum(sample, 2 * CORNER - sample)[:, None]
    motor = robot.reference_motors + swing
    joint = robot.reference_pose + 0.3 * swing
    return Samples(1_000_000_000 + APART_NS * np.arange(COUNT), motor, joint)


def _differences(model, ensemble, samples, values):
    """Members' differences from the estimate after every sample, (count, members, columns)."""
    known = model.robot.uncertainty
    doubted = known.may_slip if known else ()
    unsure = np.array([cable.name in doubted for cable in model.robot.cables])
    robots = [
        _core.Robot(model.topology, constants.copy()) for constants in ensemble.core.constants
    ]
    errors, shares = ensemble.core.reading_error, ensemble.core.friction_share
    zeros = ensemble.core.zero_error
    angle = np.concatenate([samples.motor_angle, samples.joint_angle], axis=1)
    motors = samples.motor_angle.shape[1]
    states = [initial_state(model)] * MEMBERS
    estimate = np.empty((1, model.layout.size))
    found, updates = np.zeros((COUNT, MEMBERS, ensemble.columns.size)), 0
    last = np.zeros(MEMBERS, dtype=int)
    for k in range(COUNT):
        found[k] = found[k - 1]
        for _ in range(1 if k else MEMBERS):  # one in turn; with the first sample, all
            member = updates % MEMBERS
            error, own = errors[updates % len(errors)] + zeros[member], robots[member]
            updates += 1
            passed = [CORNER] if last[member] < CORNER < k else []
            for at in (*passed, k):  # friction depends on where the axes have turned
                read = np.split(angle[at] + error, [motors])
                if k == 0:
                    states[member] = own.start(*read, shares[member])
                slips = unsure & bool(member // 2 % 2)  # the cables of every other pair
                one, stamp = (angles[None] for angles in read), np.array([at * APART_NS])
                states[member] = own.run(states[member], stamp, *one, estimate, slips)
                assert np.all(estimate[0, model.layout.status] < INVALID)
            found[k, member] = (estimate[0] - values[k])[ensemble.columns]
            last[member] = k
    return found


@pytest.mark.parametrize("name", ["prototype_positions", "finger", "davinci_jaw"])
def test_deviations_are_those_of_robots_that_take_turns_and_stddev_their_root_mean_square(name):
    model = load_model(name)
    ensemble = Ensemble(model, MEMBERS, seed=3)
    samples = _motion(model)
    estimates = ensemble.follow(samples, run(model, initial_state(model), samples)[1])
    found = _differences(model, ensemble, samples, estimates.values)
    np.testing.assert_array_equal(ensemble.deviation, found[-1])
    # a sample's standard deviations are those before its member is updated; (U5) and (U6) add more
    shown = (found**2).mean(axis=1)
    assert (estimates.stddev[1:] ** 2 >= shown[:-1] * (1.0 - 1e-9)).all()
    np.testing.assert_allclose(ensemble.variance, shown[-1], rtol=1e-6, atol=1e-12)
