"""Faults change the truth where they occur and leave the encoder readings unchanged."""

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.simulation.faults import Slack, Slip, Snap, wire
from cdrj_ros.simulation.motion import sine
from cdrj_ros.simulation.truth import simulate

TIME = np.arange(6_001) / 1000.0
ANGLE = sine(np.radians(25.0), 0.2)(TIME - 0.5)
AT = 3.0
BEFORE, AFTER = TIME < AT, AT + Slack.duration_s < TIME
LOWER, UPPER = slice(8, 16), slice(0, 8)


def _followed(robots, *faults, robot=None):
    return simulate(robot or robots.prototype(), TIME, ANGLE, cells=1, faults=faults)


@pytest.fixture(scope="module")
def sound(robots):
    return _followed(robots)


@pytest.mark.parametrize("kind", [Slack, Snap, Slip])
def test_a_fault_loosens_its_own_cable_alone_and_no_encoder_measures_it(robots, kind, sound):
    broken = _followed(robots, kind(AT, cable="lower"))
    np.testing.assert_array_equal(broken.tension[:, UPPER], sound.tension[:, UPPER])
    loss = sound.tension[:, LOWER] - broken.tension[:, LOWER]
    assert loss[AFTER].min() > 3.0
    np.testing.assert_array_equal(broken.motor_angle, sound.motor_angle)
    np.testing.assert_array_equal(broken.joint_angle, sound.joint_angle)
    model = prepare(robots.prototype())
    stamps = 1 + np.round(TIME * 1e9).astype(np.int64)
    samples = Samples(stamps, broken.motor_angle, broken.joint_angle)
    told = run(model, initial_state(model), samples)[1].values[:, model.layout.tension]
    error = np.abs(told - broken.tension)
    assert error[BEFORE].max() < 1e-6
    assert error[AFTER].max() > 3.0, "the estimator does not notice the fault"


def test_a_snap_reduces_the_tension_by_stiffness_times_its_length(robots):
    robot = robots.prototype("none")
    amount = 1e-3
    snapped = _followed(robots, Snap(AT, amount, "lower"), robot=robot)
    sound = _followed(robots, robot=robot)
    k = round((AT + Snap.duration_s) * 1000.0)
    cable = robot.cables[1]
    ratio = (1.0 + sound.tension[k, 8] / cable.axial_stiffness) / (
        1.0 + snapped.tension[k, 8] / cable.axial_stiffness
    )
    # t = EA (L / l - 1): the ratio of stretches is that of the materials, l + amount to l
    material = amount / (ratio - 1.0)
    lengths = shape_at(prepare(robot), sound.joint_angle[k]).length[LOWER].sum()
    assert material == pytest.approx(lengths, rel=0.01), "the cable's own length"
    lost_at_once = sound.tension[k, 8] - snapped.tension[k, 8]
    assert lost_at_once == pytest.approx(cable.axial_stiffness * amount / material, rel=0.02)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Snap(1.0, cable="middle"), "there are upper, lower"),
        (Slack(1.0, cable="bare"), "needs an amount"),
    ],
)
def test_an_impossible_fault_is_refused(robots, fault, words):
    robot = robots.prototype()
    bare = replace(robot.cables[0], name="bare", preload=0.0)
    if fault.cable == "bare":
        robot = replace(robot, cables=(bare,), document={})
    with pytest.raises(UsageError, match=words):
        wire(robot, (fault,))


@pytest.mark.parametrize(("kind", "amount"), [(Snap, np.nan), (Snap, -1.0), (Slip, 1e9)])
def test_an_impossible_amount_is_refused(kind, amount):
    with pytest.raises(UsageError, match=rf"amount of {kind.kind} must be in \(0, 1(00)?\]"):
        kind(1.0, amount)
