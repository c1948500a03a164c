"""What ``conditioning: predict`` gives in advance leaves no trace in what follows."""

import pytest
from support.campaign import CELL, EFFORT, MS, START, Faults, course_of, judge, run
from support.motor_alone import motion, only_measured, truth_of, without_encoder

from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.simulation import motion as motions

SLOW = {"winch": 4 * MS, "elbow": 100_144_075}
"""Intervals of the readings by axis [ns]: the elbow's readings wander against the reversals."""


@pytest.fixture(scope="module")
def fast(model):
    """Several frequencies, so that reversals are frequent."""
    return course_of(model, 12.0, motions.random(0.5, 0.4, 3))


def _everything(live):
    """All memory of an estimator that later estimates depend on."""
    found = {
        "state": live.state.values.tobytes(),
        "stamp": live.last_ns,
        "unsolved": live.unsolved,
    }
    if live.ensemble is not None:
        arrays = live.ensemble.memory() | {"variance": live.ensemble.variance}
        found |= {name: array.tobytes() for name, array in arrays.items()}
    if live.corrections is not None:
        found["sensors"] = live.corrections.memory()
    return found


@pytest.mark.parametrize(
    ("period_ns", "late_ns"), [(SLOW, 0), (SLOW, 30 * MS), ({"winch": MS, "elbow": 2 * MS}, 3 * MS)]
)
def test_prediction_leaves_the_memory_as_it_is_without(period_ns, late_ns, model, fast):
    found = {}
    outputs = {}
    course = fast.until(4001 * MS)
    for mode in ("wait", "predict"):
        sensors = CELL, EFFORT
        faults = Faults(period_ns, late_ns={"elbow": late_ns}, sensors=sensors, mode=mode)
        outputs[mode] = run(
            model, course, faults,
            watch=lambda live, mode=mode: found.update({mode: _everything(live)}),
        )  # fmt: skip
    assert found["predict"] == found["wait"]
    stamps = [output.stamp_ns for output in outputs["predict"]]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] >= outputs["wait"][-1].stamp_ns


def test_good_sensors_beside_a_slow_topic_that_is_predicted_keep_to_the_law(model, fast):
    """A cell does not correct the error of a predicted angle, which the next reading removes."""
    faults = Faults(SLOW, sensors=(CELL, EFFORT), mode="predict")
    right = {}

    def watch(live):
        right.update(live.corrections.right)

    outputs = run(model, fast, faults, watch=watch)
    verdict = judge(fast, outputs)
    assert min(right.values()) > 0.5
    assert verdict.ratio.size > 0.25 * verdict.judged
    assert verdict.beyond(2.0) <= 0.04
    assert verdict.beyond(5.0) == 0.0


def test_prediction_leaves_the_memory_of_a_robot_without_all_encoders():
    model = without_encoder("finger", "pip")
    samples = motion(model, 300)
    _, efforts = truth_of(model, samples)
    read = only_measured(model, samples)
    robot = model.robot
    motors = tuple(motor.name for motor in robot.motors)
    joints = tuple(joint.name for joint in robot.joints if joint.measured)
    found, stamps = [], []
    for mode in ("wait", "predict"):
        live = LiveEstimator(model, Options(conditioning=mode))
        given = []
        for k, stamp in enumerate(read.stamp_ns.tolist()):
            live.feed_efforts(stamp, motors, efforts[k])
            given += live.feed("motors", stamp, motors, read.motor_angle[k])[1]
            if k % 20 == 0:
                given += live.feed("joints", stamp, joints, read.joint_angle[k])[1]
        live.encoderless.solver.core.roll_back()
        found.append(
            (
                live.last_ns,
                live.encoderless.solver.core.state.tobytes(),
                live.state.values.tobytes(),
            )
        )
        stamps.append([output.stamp_ns for output in given])
    assert found[0] == found[1]
    assert stamps[0] == sorted(set(stamps[0]))
    assert stamps[1] == sorted(set(stamps[1]))
    assert stamps[1][-1] == stamps[0][-1] + 20 * MS
    assert found[0][0] > START
