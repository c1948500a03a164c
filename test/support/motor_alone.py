"""Robots with joints without encoder, and their motions."""

from copy import deepcopy

import numpy as np

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import build_robot
from cdrj_ros.simulation.drives import follow_joints
from support.places import ROBOTS

START = 1_700_000_000 * 10**9
MS = 1_000_000
NOISE = 1e-3
"""Standard deviation of the motors' efforts [N m]."""


def without_encoder(name, *joints, **more):
    """A robot of the package, exact, whose named joints have no encoder."""
    document = deepcopy(dict(load_model(str(ROBOTS / f"{name}.yaml")).robot.document))
    document["uncertainty"] = {"others": "exact"}
    for entry in document["joints"]:
        if entry["name"] in joints:
            entry |= {"measured": False, **more}
    for entry in document["motors"]:
        entry["effort_noise"] = NOISE
    return prepare(build_robot(document, name))


def motion(model, count=1500):
    """All joints swing at 200 Hz, each at its own rate, and the motors follow them."""
    robot = model.robot
    time = 0.005 * np.arange(count)
    joints = np.empty((count, len(robot.joints)))
    for j, joint in enumerate(robot.joints):
        middle, reach = joint.reference_angle, 0.25 * (joint.upper - joint.lower)
        middle = min(max(middle, joint.lower + reach), joint.upper - reach)
        joints[:, j] = middle + 0.8 * reach * np.sin((1.5 + 0.7 * j) * time)
    motors = follow_joints(model, joints).motor_angle
    return Samples(START + 5 * MS * np.arange(count), motors, joints)


def truth_of(model, samples):
    """Estimates with all encoders, and the motors' efforts with noise."""
    _, truth = run(model, initial_state(model), samples)
    exact = truth.values[:, model.layout.motor_effort]
    noise = NOISE * np.random.default_rng(3).standard_normal(exact.shape)
    return truth, exact + noise


def only_measured(model, samples):
    measured = [j for j, joint in enumerate(model.robot.joints) if joint.measured]
    return Samples(samples.stamp_ns, samples.motor_angle, samples.joint_angle[:, measured])
