"""Clean recordings have status 0, whatever the motion and the rate of the readings."""

import numpy as np
import pytest
from support.campaign import SECOND, Faults, course_of, judge, recorded, run, sine
from support.driver_faults import feed, messages_of
from support.places import PROTOTYPE, ROBOTS

from cdrj_ros.commands.simulate import parser
from cdrj_ros.commands.simulate_motion import make_plan
from cdrj_ros.model.prepared import load_model
from cdrj_ros.simulation import motion
from cdrj_ros.simulation.rig_file import load_rig
from cdrj_ros.simulation.truth import simulate

LAW = 0.001
"""Greatest share of tensions with status 0 beyond five standard deviations."""
KNOWN = 2 * SECOND
"""Time after which friction has been overcome everywhere [ns]."""


@pytest.mark.parametrize("hertz", ["0.1", "0.3", "3"])
def test_what_simulate_writes_by_default_has_status_0(hertz, model):
    """With a motor that balances a load, whose speed and acceleration are limited."""
    given = ["bag", "--robot", str(PROTOTYPE), "--frequency", hertz, "--duration", "12"]
    plan = make_plan(model, parser().parse_args(given), load_rig(""))
    truth = simulate(model.robot, plan.time, plan.joints, **plan.rule)
    course = recorded(model, truth)
    for rate in (1000, 50):
        verdict = judge(course, feed(model, messages_of(model, course, rate)), 5 * SECOND)
        assert verdict.ratio.size > 0.95 * verdict.judged
        assert verdict.beyond(2.0) <= 0.05
        assert verdict.beyond(5.0) <= LAW


@pytest.mark.parametrize("hertz", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("name", ["finger", "wrist", "parallel"])
def test_joints_that_move_together_have_status_0(name, hertz, tmp_path):
    """The robot is the file's, whose numbers are exact; no axis exceeds its ``max_speed``."""
    file = tmp_path / f"{name}.yaml"
    exact = "\nuncertainty: {others: exact}\n"
    file.write_text((ROBOTS / f"{name}.yaml").read_text(encoding="utf-8") + exact)
    model = load_model(str(file))
    share = min(0.35, 0.25 / hertz)

    def angle(time):
        columns = []
        for k, joint in enumerate(model.robot.joints):
            width, centre = joint.upper - joint.lower, 0.5 * (joint.lower + joint.upper)
            columns.append(centre + motion.sine(share * width, hertz * (1.0 + 0.1 * k))(time))
        return np.column_stack(columns)

    course = course_of(model, 6.0, angle)
    for rate in (1000, 200):
        verdict = judge(course, feed(model, messages_of(model, course, rate)), KNOWN)
        assert verdict.ratio.size > 0.9 * verdict.judged
        assert verdict.beyond(5.0) <= LAW


def test_members_of_the_ensemble_see_every_reversal_of_a_fast_motion(model):
    """Each is updated every 64 ms, within which the joint may turn and come back."""
    course = course_of(model, 5.0, sine(3.0))
    verdict = judge(course, run(model, course, Faults()), KNOWN)
    assert verdict.ratio.size > 0.98 * verdict.judged
    assert verdict.beyond(5.0) <= LAW


def test_tensions_between_the_readings_of_a_gap_say_nothing_of_lags(model):
    course = course_of(model, 8.0, sine(0.8))
    gap = [("elbow", 4 * SECOND, 4 * SECOND + SECOND // 5)]
    outputs = run(model, course, Faults(gaps=gap))
    verdict = judge(course, outputs, 5 * SECOND)
    assert verdict.ratio.size > 0.98 * verdict.judged
    assert verdict.beyond(5.0) <= LAW
