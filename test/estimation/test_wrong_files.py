"""What a robot file does not state is in the standard deviation, or the status is not OK."""

import numpy as np
import pytest
from scipy.signal import lfilter
from support.page_lines import loaded_tool
from support.places import ROBOTS, ROOT

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.estimation.ensemble import Ensemble
from cdrj_ros.estimation.estimator import Sample, initial_state
from cdrj_ros.estimation.model_error import unmodelled
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.packing import constant_views
from cdrj_ros.model.prepared import load_model, prepare
from cdrj_ros.robot.reader import build_robot, parse_robot


@pytest.fixture(scope="module")
def tool():
    return loaded_tool(ROOT / "tools" / "wrong_files.py")


@pytest.fixture(scope="module")
def motion(tool):
    return tool.true_motion(load_model(tool.ROBOT), 12.0)


@pytest.mark.parametrize("k", [1, 3, 4, 5, 8])
def test_a_wrong_number_is_covered_or_the_status_is_not_ok(tool, motion, k):
    found = tool.row(tool.ROWS[k], motion)
    assert found[0].all > 0.03, "the row would be no test of anything"
    for one in found[:3]:
        assert one.covered >= 0.9
        assert one.misleading <= 0.1
    assert found[3].covered < 0.6, "an exact file does not know better"


def test_a_drum_that_forgets_is_among_the_members(tool):
    motion = tool.true_motion(load_model(tool.ROBOT), 30.0)
    wrong = next(one for one in tool.ROWS if one.forgets)
    _, _, narrow, exact = tool.row(wrong, motion)
    assert narrow.covered >= 0.9
    assert exact.covered < 0.75


DRUM, CREPT, WOUND, DRAG, RADII, LOST = 2, 3, 4, 5, 7, 10


@pytest.mark.parametrize(
    ("k", "sensors", "seconds"),
    [(DRUM, ("effort",), 60.0), (CREPT, ("effort",), 20.0), (DRAG, ("cells",), 30.0),
     (DRAG, ("effort", "cells"), 30.0), (WOUND, ("effort", "cells"), 60.0),
     (RADII, ("effort", "cells"), 30.0), (LOST, ("effort",), 8.0)],
)  # fmt: skip
def test_of_what_sensors_show_of_a_wrong_file_nothing_is_sure_and_wrong(tool, k, sensors, seconds):
    """Whether they follow it, or cannot tell it from something else."""
    model, wrong = load_model(tool.ROBOT), tool.HEARD[k]
    motion = tool.true_motion(model, seconds)
    truth = tool.true_readings(tool.fresh_model(model), wrong, motion)
    read = tool.readings(model, motion, wrong.zero)
    assert tool.heard(model, read, truth, sensors).misleading <= 0.05


@pytest.mark.parametrize(
    ("zero", "cell"),
    [(-2.0, "upper/8"), (2.0, "lower/8"), (-3.0, "upper/8"), (-3.0, "lower/8")],
)
def test_of_a_cable_without_load_cell_a_wrong_zero_leaves_nothing_sure_and_wrong(tool, zero, cell):
    """Its antagonist's cell shows that something is off, and a joint's zero changes both.

    A verdict needs the readings of 3 s.
    """
    model, motion = load_model(tool.ROBOT), tool.true_motion(load_model(tool.ROBOT), 16.0)
    wrong = tool.Wrong("zero", zero=np.radians(zero))
    true = tool.true_readings(tool.fresh_model(model), wrong, motion).tension
    read, live, wrongly = tool.readings(model, motion, wrong.zero), LiveEstimator(model), []
    element = model.layout.elements.index(cell)
    for k, stamp in enumerate(read.stamp_ns.tolist()):
        live.feed_tensions(stamp, [cell], [true[k, element] + 0.1 * (k % 3 - 1)], [0.1])
        out = live.take(read.at(k))
        far = np.abs(out.tension - true[k]) > 2.0 * out.stddev[:16]
        wrongly.append(far & (out.status == 0))
    other = slice(8, 16) if element < 8 else slice(0, 8)
    assert np.array(wrongly)[600:, other].mean() <= 0.05


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_preloads_that_are_all_wrong_are_within_five_deviations_of_an_effort_from_the_start(
    tool, factor
):
    """It hardly shows them: what is left is how far off they may have been from the start."""
    model, motion = load_model(tool.ROBOT), tool.true_motion(load_model(tool.ROBOT), 4.0)
    wrong = tool.Wrong("preloads", {"cables.*.preload": factor})
    truth = tool.true_readings(tool.fresh_model(model), wrong, motion)
    read, live, beyond = tool.readings(model, motion, 0.0), LiveEstimator(model), []
    for k, stamp in enumerate(read.stamp_ns.tolist()):
        live.feed_efforts(stamp, ["winch"], truth.effort[k] + 0.01 * (k % 3 - 1))
        out = live.take(read.at(k))
        far = np.abs(out.tension - truth.tension[k]) > 5.0 * out.stddev[:16]
        beyond.append(far[out.status == 0])
    assert np.concatenate(beyond).size > 0
    assert np.concatenate(beyond).mean() <= 0.001


@pytest.mark.parametrize("pause", ["suspended", "gap"])
def test_what_a_slip_has_taken_stays_in_doubt_over_a_break(tool, pause):
    """No load cell shows it afterwards."""
    model, motion = load_model(tool.ROBOT), tool.true_motion(load_model(tool.ROBOT), 45.0)
    true = tool.true_readings(tool.fresh_model(model), tool.ROWS[DRUM], motion).tension
    read, live = tool.readings(model, motion, 0.0), LiveEstimator(model)
    until, late, ratios = 8000, 0, []
    for k in range(motion.stamp_ns.size):
        if k < until:
            cells = true[k, tool.LAST] + 0.01 * (k % 7)
            live.feed_tensions(int(read.stamp_ns[k]), ("upper/8", "lower/8"), cells, (0.1, 0.1))
        elif k == until:
            late = 3_000_000_000 if pause == "gap" else 0
            if pause == "suspended":
                live.suspend()
        sample = read.at(k)
        out = live.take(sample._replace(stamp_ns=sample.stamp_ns + late))
        if k > until:
            ratios.append(np.abs(out.tension - true[k]) / out.stddev[:16])
    assert np.mean(np.array(ratios) < 2.0) > 0.95


SLACK = """
name: slack
motors: [{name: m}]
joints: []
cables:
  - name: c
    axial_stiffness: 1000
    preload: 0
    slack_tension: 0.2
    nodes:
      - {type: winch, motor: m, radius: 0.01, winding: 1}
      - {type: pulley, radius: 0.01, wrap_angle_deg: 90}
      - {type: anchor}
    spans: [1.0, 1.0]
uncertainty: {others: exact}
"""


def test_a_slack_cable_has_a_spread():
    model = prepare(parse_robot(SLACK))
    ensemble = Ensemble(model)
    sample = Sample(1, np.array([-1.0]), np.zeros(0))  # paid out by 10 mm
    _, estimate = ensemble.step(initial_state(model), sample)
    stddev = estimate.stddev
    assert estimate.tension.tolist() == [0.0, 0.0]
    assert stddev[:2].tolist() == [0.2, 0.2]
    assert stddev[2] == pytest.approx(0.2 * np.sqrt(2.0))  # the force on a pulley wrapped by 90°
    assert stddev[3] == pytest.approx(0.2 * 0.01)


def test_an_error_of_efforts_reaches_tensions_through_the_radii():
    text = SLACK.replace("others: exact", "others: exact, model_error: {effort/m: 0.003}")
    table = unmodelled(prepare(parse_robot(text)))
    expected = [0.3, 0.3, 0.3 * np.sqrt(2.0), 0.003]
    assert np.sqrt(table[0]).tolist() == pytest.approx(expected)


def test_the_models_error_is_in_the_standard_deviation():
    taut = SLACK.replace("preload: 0", "preload: 20")
    text = taut.replace("others: exact", "others: exact, model_error: {tension/c/2: 0.7}")
    sample = Sample(1, np.zeros(1), np.zeros(0))
    found = []
    for one in (taut, text):
        model = prepare(parse_robot(one))
        found.append(Ensemble(model).step(initial_state(model), sample)[1].stddev)
    assert np.sqrt(found[1][:2] ** 2 - found[0][:2] ** 2) == pytest.approx(0.7)


@pytest.mark.parametrize("name", sorted(file.stem for file in ROBOTS.glob("*.yaml")))
def test_every_shipped_robot_is_estimated_with_its_spread(name):
    model = load_model(name)
    live = LiveEstimator(model)
    motors, joints = (
        np.array([one.reference_angle for one in axes])
        for axes in (model.robot.motors, model.robot.joints)
    )
    for k in range(64):
        out = live.take(Sample(10**9 + k * 1_000_000, motors, joints))
    tensions = len(model.layout.elements)
    assert np.isfinite(out.stddev).all()
    assert (out.stddev[:tensions] > 0.0).all()


def fresh(tool):
    return tool.fresh_model(load_model(tool.ROBOT))


def test_a_tare_narrows_a_fresh_file(tool):
    live = LiveEstimator(fresh(tool))
    widths, preloads = [], []
    for then in (live.tare, lambda: live.set_preload({"upper": 36.85}), lambda: ""):
        for k in range(400):
            out = live.take(Sample(10**9 + k * 1_000_000, np.zeros(1), np.zeros(1)))
        widths.append(float(out.stddev[:8].mean()))  # of one cable; draws vary with NumPy
        cables = constant_views(live.model.sizes, live.ensemble.core.constants).cables
        preloads.append(float(cables["preload"][:, 0].std()) / 36.85)
        then()
    assert widths[0] > 10.0
    assert widths[1] < 0.5 * widths[0]
    assert preloads == pytest.approx([0.1, 0.1, 0.045], rel=1e-3)


def test_a_delay_is_covered_also_where_a_smaller_one_is_stated(tool, motion):
    """The joint's readings have passed a low-pass filter of 20 ms, which no stamp shows."""
    model = load_model(tool.ROBOT)
    true = tool.true_readings(model, tool.ROWS[0], motion).tension
    past, (here,) = np.exp(-0.005 / 0.02), motion.joint_angle[0]
    late = lfilter([1.0 - past], [1.0, -past], motion.joint_angle[:, 0] - here) + here
    stamps = motion.stamp_ns
    axes = {"winch": motion.motor_angle[:, 0], "elbow": late}
    motors, joints = ({name: Series(stamps, stamps, axes[name])} for name in ("winch", "elbow"))
    covered = []
    for seconds in (0.0001, 0.01):
        stated = {"joints.elbow.clock_offset": seconds, "cables.upper.preload": 0.3}
        block = {"others": "exact", "parameters": [*stated], "stddev": [*stated.values()]}
        robot = build_robot({**model.robot.document, "uncertainty": block}, "late")
        found = estimate(prepare(robot), condition(robot, motors, joints), uncertainty=True)
        rows = found.stamp_ns > stamps[0] + 1_000_000_000
        error = np.abs(found.tension - true[np.searchsorted(stamps, found.stamp_ns)])[rows]
        covered.append(float(np.mean(error <= 2.0 * found.tension_stddev[rows])))
    assert min(covered) > 0.95
