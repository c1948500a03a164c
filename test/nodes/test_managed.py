"""The managed estimator: its transitions, over the services of a lifecycle node."""

import numpy as np
import pytest
from cdrj_msgs.msg import CableTensions
from cdrj_msgs.srv import SetPreload
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.parameter import Parameter
from support.estimators import (
    INPUTS,
    ROBOT,
    feed,
    hear_diagnostics,
    listen,
    sample_at,
    tensions,
    values_of,
)

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.model.packing import STALE
from cdrj_ros.model.prepared import load_model
from cdrj_ros.nodes.estimator import ManagedEstimator

OUTPUTS = ("tensions", "nodal_forces", "efforts", "efforts_stddev", "tension_states")


class Managed:
    """A managed estimator in this process, and calls of its services."""

    def __init__(self, bench, **given):
        given = {"robot": ROBOT, "timeout": 3600.0, **given}
        overrides = [Parameter(key, value=value) for key, value in given.items()]
        self.bench, self.node = bench, ManagedEstimator(parameter_overrides=overrides)
        self.estimation = self.node.estimation
        bench.executor.add_node(self.node)
        bench.nodes.append(self.node)

    def change(self, label):
        """Ask for a transition by its label; True if it has been made."""
        request = ChangeState.Request(transition=Transition(label=label))
        return bool(self.bench.call(ChangeState, "/cdrj/estimator/change_state", request).success)

    @property
    def state(self):
        answer = self.bench.call(GetState, "/cdrj/estimator/get_state", GetState.Request())
        return str(answer.current_state.label)

    def ends(self):
        """Numbers of open outputs and of subscribed inputs."""
        graph = self.bench.node
        return (
            sum(graph.count_publishers(f"/cdrj/{topic}") for topic in OUTPUTS),
            sum(graph.count_subscribers(f"/cdrj/{topic}") for topic in INPUTS),
        )


@pytest.fixture
def managed(bench):
    return lambda **given: Managed(bench, **given)


def test_configure_opens_outputs_activate_opens_inputs_and_the_way_back_closes_them(bench, managed):
    one = managed()
    for _ in range(2):
        for label, state, ends in (
            ("configure", "inactive", (5, 0)),
            ("activate", "active", (5, 2)),
            ("deactivate", "inactive", (5, 0)),
            ("cleanup", "unconfigured", (0, 0)),
        ):
            assert one.change(label)
            assert one.state == state
            assert bench.until(lambda: one.ends() == ends), (state, one.ends())  # noqa: B023
    assert all(one.change(label) for label in ("configure", "activate", "shutdown"))
    assert one.state == "finalized"
    assert bench.until(lambda: one.ends() == (0, 0))


def test_the_process_survives_a_request_for_the_number_of_such_a_transition(
    bench, start_executable
):
    process = start_executable("estimator", "--managed", "--ros-args", "-p", f"robot:={ROBOT}")
    states = bench.node.create_client(GetState, "/cdrj/estimator/get_state")
    client = bench.node.create_client(ChangeState, "/cdrj/estimator/change_state")
    assert bench.until(lambda: states.service_is_ready() and client.service_is_ready())

    def answer(make):
        """Ask again if there is none: the node may not have discovered the client yet."""
        for _ in range(60):
            future = make()
            if bench.until(future.done, 1.0):
                return future.result()
        raise AssertionError(process.poll())

    def state():
        return str(answer(lambda: states.call_async(GetState.Request())).current_state.label)

    assert state() == "unconfigured"
    for number in (Transition.TRANSITION_DEACTIVATE, 99):
        request = ChangeState.Request(transition=Transition(id=number))
        unanswered = client.call_async(request)
        assert state() == "unconfigured"
        assert not unanswered.done()
    request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    client.call_async(request)
    assert bench.until(lambda: state() == "inactive")
    assert process.poll() is None


def test_deactivate_publishes_stale_and_activate_continues_the_friction_history(bench, managed):
    one = managed(tracking_bandwidth=0.0)
    assert one.change("configure")
    said = bench.listen(CableTensions, "/cdrj/tensions")
    assert bench.until(lambda: one.estimation.outputs.tensions.get_subscription_count() == 1)
    assert one.change("activate")
    listen(one.estimation)
    feed(one.estimation, 0, 300)
    assert bench.until(lambda: len(said) == 300)
    assert one.change("deactivate")
    assert bench.until(lambda: len(said) == 301)
    assert all(status & STALE for status in said[-1].status)
    assert not any(status & STALE for status in said[-2].status)

    assert one.change("activate")
    listen(one.estimation)
    feed(one.estimation, 300, 400)
    model = load_model(ROBOT)
    state, whole = initial_state(model), []
    for k in range(400):
        state, estimate = step(model, state, sample_at(k))
        whole.append(estimate.tension.copy())
    assert np.array_equal(tensions(one.estimation), whole)


def test_a_robot_that_cannot_be_loaded_leaves_the_node_unconfigured_until_it_is_corrected(managed):
    one = managed(robot="nowhere.yaml")
    assert not one.change("configure")
    assert one.state == "unconfigured"
    corrected = [Parameter("robot", value=ROBOT), Parameter("timeout", value=2)]
    assert all(result.successful for result in one.node.set_parameters(corrected))
    assert one.change("configure")
    assert one.estimation.timeout_s == 2.0
    (result,) = one.node.set_parameters([Parameter("timeout", value=3.0)])
    assert not result.successful
    assert "timeout can only change while unconfigured" in result.reason
    (result,) = one.node.set_parameters([Parameter("friction.rho", value=0.4)])
    assert result.successful


def test_cleanup_returns_to_the_given_preload_and_friction(bench, managed):
    one = managed(**{"friction.rho": 0.3})
    assert one.change("configure")
    request = SetPreload.Request(cable=["upper"], preload=[20.0])
    assert bench.call(SetPreload, "/cdrj/estimator/set_preload", request).success
    assert list(one.node.get_parameter("preload").value) == [20.0, 26.26]
    assert one.change("cleanup")
    assert one.node.get_parameter("friction.mu_c").value == -1.0
    assert one.change("configure")
    assert list(one.node.get_parameter("preload").value) == [36.85, 26.26]
    assert one.node.get_parameter("friction.rho").value == 0.3


def test_diagnostics_tell_the_state(bench, managed):
    said = []
    hear_diagnostics(bench, said)
    one = managed()
    assert bench.until(lambda: one.estimation.diagnostics.get_subscription_count() == 1)

    def status():
        said.clear()
        one.estimation.diagnose()
        assert bench.until(lambda: bool(said))
        return said[0]

    unconfigured = status()
    assert "configure loads it" in unconfigured.message
    assert one.change("configure")
    inactive = status()
    assert inactive.message.startswith("inactive: no estimates")
    assert inactive.hardware_id == "prototype"
    assert one.change("activate")
    listen(one.estimation)
    feed(one.estimation, 0, 100)
    active = status()
    assert active.message.startswith(("estimating", "unsure: lower/8"))
    assert one.change("shutdown")
    states = [
        values_of(found)["lifecycle state"] for found in (unconfigured, inactive, active, status())
    ]
    assert states == ["unconfigured", "inactive", "active", "finalized"]
