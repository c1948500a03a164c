"""Estimator and simulated rig beside the truth.

The estimator lets the friction of an arc act in the middles of a few cells that move along with it;
many cells leave next to nothing of the difference.  The cells of the rig are fixed to the surfaces
where a joint moves an end of the arc.
"""

from functools import cache

import numpy as np
import pytest
from support.state import state_views

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import prepare
from cdrj_ros.simulation.assembly import make_rig
from cdrj_ros.simulation.truth import simulate
from truth.scenes import MOTIONS, scene, truth_of, with_cells


@cache
def known(name):
    made = scene(name)
    return made, truth_of(made)


def errors(robot, made, truth):
    """Mean relative error and largest error [N] of tensions, and relative error of efforts."""
    model, after = prepare(robot), made.time >= made.cycle
    stamps = 1_000_000_000 + np.round(made.time * 1e9).astype(np.int64)
    samples = Samples(stamps, truth.motor, made.joint)
    values, layout = run(model, initial_state(model), samples)[1].values[after], model.layout
    off = np.abs(values[:, layout.tension] - truth.tension[after])
    efforts = []
    for part, true in (
        (layout.joint_effort, truth.joint_effort[after]),
        (layout.motor_effort, truth.motor_effort[after]),
    ):
        wrong = np.sqrt(np.mean((values[:, part] - true) ** 2, axis=0))
        efforts.append(wrong / np.sqrt(np.mean(true**2, axis=0)))
    return float(np.mean(off / truth.tension[after])), off.max(), np.concatenate(efforts).max()


@pytest.mark.parametrize("name", MOTIONS)
def test_tensions_and_efforts_are_those_of_cells_on_the_surfaces(name):
    made, truth = known(name)
    mean, _, effort = errors(made.robot, made, truth)
    assert mean <= 0.001
    assert effort <= 0.005


@pytest.mark.parametrize("name", MOTIONS)
def test_many_contacts_a_body_give_the_truth_itself(name):
    made, truth = known(name)
    mean, largest, effort = errors(with_cells(made.robot, 12), made, truth)
    assert mean <= 0.0002
    assert largest <= 0.05
    assert effort <= 0.001


@pytest.mark.parametrize("name", MOTIONS)
def test_the_rig_is_the_truth_from_the_first_sample_on(name):
    made, truth = known(name)
    rig = simulate(made.robot, made.time, made.joint, motor_angle=truth.motor, cells=32)
    off = np.abs(rig.tension - truth.tension)
    assert np.mean(off / truth.tension) <= 0.0002
    assert off.max() <= 0.05
    for one, true in (
        (rig.joint_effort, truth.joint_effort), (rig.motor_effort, truth.motor_effort),
    ):  # fmt: skip
        assert np.all(np.abs(one - true).max(axis=0) <= 0.001 * np.abs(true).max(axis=0))


@pytest.mark.parametrize("name", MOTIONS)
def test_no_material_is_lost_as_cells_of_the_rig_come_and_leave(name):
    made, truth = known(name)
    model = make_rig(made.robot, 24).fine
    state, states = initial_state(model), []
    for time, motor, joint in zip(made.time, truth.motor, made.joint, strict=True):
        state, _, solved = model.core.step(state, round(time * 1e9), motor, joint)
        assert solved
        states.append(state.values)
    assert model.sizes.surfaces == {"sheath": 0, "carriage": 2, "platform": 4}.get(name, 1)
    found = state_views(model.sizes, np.array(states))
    material = found.material.sum(axis=1)
    for drum in found.drums.T:
        top = drum["points"].astype(int) - 1
        material += drum["material"][np.arange(top.size), top]
    np.testing.assert_allclose(material, material[0], rtol=1e-12)
    assert found.material.min() > 0.0
