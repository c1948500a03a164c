"""The estimator at run time: parameters, services, clocks, diagnostics, and several nodes."""

import numpy as np
import pytest
from cdrj_msgs.msg import CableTensions
from cdrj_msgs.srv import SetPreload
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from support.estimators import (
    BEGIN,
    MILLISECOND,
    ROBOT,
    SECOND,
    Clock,
    changed,
    expected,
    feed,
    hear_diagnostics,
    hold,
    sample_at,
    tensions,
    values_of,
)

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.model.packing import OVERLOAD, SLACK, STALE, UNSURE
from cdrj_ros.model.prepared import load_model
from cdrj_ros.nodes.diagnostics import Health, report_of, status_of


@pytest.fixture(scope="module")
def model():
    return load_model(ROBOT)


# parameters ------------------------------------------------------------------------------------


def test_friction_may_change_while_running_and_the_history_stays(bench, model):
    estimator = bench.estimator()
    feed(estimator, 0, 300)
    (result,) = estimator.node.set_parameters([Parameter("friction.rho", value=0.35)])
    assert result.successful
    feed(estimator, 300, 600)
    (result,) = estimator.node.set_parameters([Parameter("friction.rho", value=-1.0)])
    assert result.successful
    feed(estimator, 600, 700)

    other = changed(model, rho=0.35)
    pieces = (range(300), range(300, 600), range(600, 700))
    assert np.array_equal(tensions(estimator), expected((model, other, model), pieces))
    unchanged = expected((model,), (range(700),))
    assert not np.allclose(tensions(estimator)[300:600], unchanged[300:600], rtol=1e-4)


REFUSED = [
    ({"friction.mu_s": 0.05}, "mu_s must be at least mu_c"),
    ({"friction.rho": 2.0}, "rho"),
    ({"friction.rho": -0.5}, "friction.rho must be at least 0"),
    ({"friction.rho": float("nan")}, "rho"),
    ({"friction.mu_c": float("inf")}, "mu_c"),
    ({"preload": [1.0]}, "preload needs 2"),
    ({"preload": [-1.0, 2.0]}, "preload of upper must be in"),
    ({"preload": [float("nan"), 2.0]}, "preload of upper must be in"),
    ({"friction.rho": 0.3, "preload": [1.0, 2e6]}, "preload of lower must be in"),
    ({"unsure_share": float("nan")}, "unsure_share"),
    ({"tracking_bandwidth": 0.05}, "0 for no filter"),
    ({"tracking_bandwidth": 1e4}, "tracking_bandwidth"),
    ({"timeout": 1.0}, "read-only"),
    ({"robot": "another.yaml"}, "read-only"),
    ({"use_sim_time": True}, "use_sim_time is read-only after the start"),
    ({"friction.rho": "much"}, "type"),
]


def test_a_refused_change_states_the_reason_and_changes_nothing(bench, model):
    estimator, beside = bench.estimator(), bench.estimator("-r", "__ns:=/beside")
    for k, (change, words) in enumerate(REFUSED):
        feed(estimator, 10 * k, 10 * k + 10)
        feed(beside, 10 * k, 10 * k + 10)
        before = [estimator.node.get_parameter_or(name).value for name in change]
        result = estimator.node.set_parameters_atomically(
            [Parameter(name, value=value) for name, value in change.items()]
        )
        assert not result.successful, change
        assert words in result.reason, (change, result.reason)
        assert [estimator.node.get_parameter_or(name).value for name in change] == before
    last = 10 * len(REFUSED)
    feed(estimator, last, last + 50)
    feed(beside, last, last + 50)
    assert np.array_equal(tensions(estimator), expected((model,), (range(last + 50),)))
    for one, other in zip(estimator.answers, beside.answers, strict=True):
        assert np.array_equal(one.stddev, other.stddev)


# services --------------------------------------------------------------------------------------


def test_the_responses_of_the_services_describe_their_effect(bench):
    estimator = bench.estimator()
    tare, reset = "/cdrj/estimator/tare", "/cdrj/estimator/reset"
    early = bench.call(Trigger, tare, Trigger.Request())
    assert not early.success
    assert "no angles yet" in early.message
    feed(estimator, 0, 100)

    moving = bench.call(Trigger, tare, Trigger.Request())
    assert not moving.success
    assert "at rest" in moving.message
    hold(estimator, 99)
    done = bench.call(Trigger, tare, Trigger.Request())
    assert done.success
    angle = sample_at(99).motor_angle[0]
    assert f"winch {angle:.6g} rad" in done.message
    assert estimator.live.model.robot.motors[0].reference_angle == angle
    feed(estimator, 99, 101)
    # in the reference pose: the preload, up to the filter's estimate within an encoder count
    assert np.allclose(tensions(estimator)[-2][:8], 36.85, rtol=5e-3)

    done = bench.call(
        SetPreload,
        "/cdrj/estimator/set_preload",
        SetPreload.Request(cable=["upper"], preload=[20.0]),
    )
    assert done.success
    assert "36.85 N, now 20 N" in done.message
    for cable, preload, words in (
        (["nobody"], [1.0], "there is no cable 'nobody'"),
        (["upper"], [-1.0], "preload of upper must be in"),
        (["upper"], [float("nan")], "preload of upper must be in"),
        (["upper"], [], "as many preloads as cables"),
        (["upper", "upper"], [1.0, 2.0], "named twice"),
        ([], [], "name at least one cable"),
    ):
        request = SetPreload.Request(cable=cable, preload=preload)
        answer = bench.call(SetPreload, "/cdrj/estimator/set_preload", request)
        assert not answer.success
        assert words in answer.message
        assert answer.message.startswith("nothing changed")
    assert [c.preload for c in estimator.live.model.robot.cables] == [20.0, 26.26]

    done = bench.call(Trigger, reset, Trigger.Request())
    assert done.success
    assert "discarded" in done.message
    assert estimator.live.sample is None


# time ------------------------------------------------------------------------------------------


def test_age_rate_and_staleness_follow_simulated_time(bench):
    """Ten simulated seconds pass quickly; the clock stops, then continues without inputs."""
    estimator = bench.estimator(use_sim_time=True, timeout=0.5)
    said = []
    hear_diagnostics(bench, said)
    clock = Clock(bench, estimator)
    assert bench.until(lambda: bench.node.count_publishers("/diagnostics") > 0)

    for k in range(0, 4000, 50):
        clock.set(BEGIN + k * MILLISECOND)
        feed(estimator, k, k + 50)
        bench.executor.spin_once(timeout_sec=0.0)
    assert bench.until(lambda: bool(said))
    assert bench.until(lambda: not said[-1].message.startswith("waiting"), 5.0)
    values = values_of(said[-1])
    assert 900.0 < float(values["rate [Hz]"]) < 1100.0
    assert float(values["age [s]"]) <= 0.5

    heard = bench.listen(CableTensions, "/cdrj/tensions")
    assert bench.until(lambda: bench.node.count_publishers("/cdrj/tensions") > 0)
    # while the simulated clock stands still, the steady clock is used
    assert bench.until(lambda: bool(heard) and all(flags & STALE for flags in heard[-1].status))
    assert bench.until(lambda: "/clock stands still" in said[-1].message, 5.0)
    clock.set(BEGIN + 4000 * MILLISECOND)
    feed(estimator, 4000, 4001)
    assert bench.until(lambda: not any(flags & STALE for flags in heard[-1].status))
    heard.clear()

    last = BEGIN + 4000 * MILLISECOND
    for k in range(20):
        clock.set(last + k * SECOND // 10)
        bench.executor.spin_once(timeout_sec=0.05)
    assert bench.until(lambda: bool(heard))
    assert all(flags & STALE for flags in heard[-1].status)
    assert bench.until(lambda: said[-1].message.startswith("no input for 0.5 s"))
    assert said[-1].level == said[-1].STALE
    assert float(values_of(said[-1])["age [s]"]) > 0.5


@pytest.mark.parametrize("service", ["reset", "tare", "set_preload"])
def test_after_a_change_the_last_message_is_marked_stale(bench, service):
    estimator = bench.estimator()
    heard = bench.listen(CableTensions, "/cdrj/tensions")
    assert bench.until(lambda: estimator.outputs.tensions.get_subscription_count() > 0)
    feed(estimator, 0, 10)
    hold(estimator, 9)
    count = len(estimator.answers)
    assert bench.until(lambda: len(heard) == count)
    assert not any(flags & STALE for flags in heard[-1].status)
    kind, request = Trigger, Trigger.Request()
    if service == "set_preload":
        kind = SetPreload
        request = SetPreload.Request(cable=["upper"], preload=[30.0])
    assert bench.call(kind, f"/cdrj/estimator/{service}", request).success
    assert bench.until(lambda: len(heard) == count + 1)
    assert all(flags & STALE for flags in heard[-1].status)
    feed(estimator, 10, 20)
    assert bench.until(lambda: len(heard) == count + 11)
    assert not any(flags & STALE for flags in heard[-1].status)


def test_a_tare_is_refused_while_the_inputs_are_silent(bench):
    estimator = bench.estimator(use_sim_time=True, timeout=0.5)
    clock = Clock(bench, estimator)
    clock.set(BEGIN)
    feed(estimator, 0, 500)
    clock.set(BEGIN + 2 * SECOND)
    before = estimator.live.model
    answer = bench.call(Trigger, "/cdrj/estimator/tare", Trigger.Request())
    assert not answer.success
    assert answer.message.startswith("nothing changed: no estimate for 0.5 s")
    assert estimator.live.model is before
    feed(estimator, 500, 600)
    hold(estimator, 599)
    assert bench.call(Trigger, "/cdrj/estimator/tare", Trigger.Request()).success
    assert estimator.live.model.robot.motors[0].reference_angle == sample_at(599).motor_angle[0]


# diagnostics -----------------------------------------------------------------------------------

KEYS = {
    "rate [Hz]", "age [s]", "lag behind the newest reading [ms]", "steps", "step time p50 [us]",
    "step time p99 [us]", "samples not solved", "slack elements", "overloaded elements",
    "unsure elements", "preload [N]", "readings accepted", "clock jumps", "gaps", "readings held",
    "readings for another topic", "readings that waited too long",
    "sensor readings not used in time",
}  # fmt: skip


def test_diagnostics_describe_every_problem(bench):
    from cdrj_ros.estimation.refusals import REFUSALS

    estimator = bench.estimator()
    said = []
    hear_diagnostics(bench, said)
    assert bench.until(lambda: bool(said))
    first = said[-1]
    assert first.level == first.WARN
    assert first.message.startswith("waiting: no reading of winch, elbow accepted")
    assert (first.name, first.hardware_id) == ("cdrj/estimator", "prototype")
    assert {*values_of(first)} >= KEYS | {f"refused: {cause}" for cause in REFUSALS}

    def status(age_s=0.01):
        health = Health(0.5, age_s, age_s, 1000.0)
        found = report_of(estimator.live, estimator.latest, health, estimator.times)
        return status_of("e", found, "prototype")

    def flagged(flag):
        return int(sum(int(s) & flag != 0 for s in estimator.latest.status))

    feed(estimator, 0, 1500)
    bench.until(lambda: said[-1] is not first)
    estimator.live.set_unsure_share(10.0)
    feed(estimator, 1500, 1600)
    assert (status().level, status().message) == (first.OK, "estimating")
    assert (status(0.6).level, status(0.6).message) == (first.STALE, "no input for 0.5 s")
    assert values_of(status())["steps"] == "1600"

    estimator.live.set_unsure_share(1e-6)
    feed(estimator, 1600, 1601)
    assert flagged(UNSURE) == 16
    assert status().level == first.WARN
    assert status().message.startswith("unsure: upper/1")
    estimator.live.set_unsure_share(10.0)

    estimator.live.set_preload({"upper": 0.5, "lower": 0.5})
    feed(estimator, 1601, 2000)
    assert flagged(SLACK) > 0
    assert status().level == first.WARN
    assert status().message.startswith("slack: ")
    assert values_of(status())["slack elements"] in status().message

    estimator.live.set_preload({"upper": 130.0})
    feed(estimator, 2000, 2100)
    assert flagged(OVERLOAD) > 0
    assert status().level == first.ERROR
    assert status().message.startswith("overload: upper/")
    assert "upper 130" in values_of(status())["preload [N]"]

    estimator.live.set_preload({"upper": 36.85, "lower": 26.26})
    for k in range(2100, 2400):
        feed(estimator, k, k + 1)
        estimator.live.feed_tensions(sample_at(k).stamp_ns, ["upper/8", "x/1"], [1e4, 0.0], [])
    assert "sensors that contradict the others or the robot: upper/8" in status().message
    assert status().level == first.WARN
    assert values_of(status())["sensor upper/8"].startswith("right with 0%; ")
    assert int(values_of(status())["refused: unknown sensor"]) == 300


# state file ------------------------------------------------------------------------------------


def test_the_next_node_continues_from_the_file_that_every_diagnosis_and_change_writes(
    bench, model, tmp_path
):
    given = {"state_file": tmp_path / "state", "tracking_bandwidth": 0.0}
    killed = bench.estimator(**given)
    feed(killed, 0, 300)
    killed.diagnose()
    after = bench.estimator("-r", "__ns:=/after", **given)
    feed(after, 300, 400)
    state, whole = initial_state(model), []
    for k in range(400):
        state, estimate = step(model, state, sample_at(k))
        whole.append(estimate.tension.copy())
    assert np.array_equal(tensions(after), whole[300:])

    hold(after, 399)
    assert bench.call(Trigger, "/after/estimator/tare", Trigger.Request()).success
    request = SetPreload.Request(cable=["lower"], preload=[20.0])
    assert bench.call(SetPreload, "/after/estimator/set_preload", request).success
    last = bench.estimator("-r", "__ns:=/last", **given)
    hold(last, 399, since=320)
    found = tensions(last)[0]
    assert np.allclose(found[:8], 36.85)
    assert np.allclose(found[8:], 20.0)
    assert last.live.model.robot.motors == after.live.model.robot.motors
