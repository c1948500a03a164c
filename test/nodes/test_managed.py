"""The managed estimator: its transitions, over the services of a lifecycle node."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from support.estimators import (
    INPUTS,
    ROBOT,
    Bench,
    expected,
    feed,
    hear_diagnostics,
    sample_at,
    tensions,
    values_of,
)

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.status import STALE

OUTPUTS = ("tensions", "nodal_forces", "efforts", "efforts_stddev")


class Managed:
    """A managed estimator in this process, and calls of its services."""

    def __init__(self, bench: Bench, **given: Any) -> None:
        from rclpy.parameter import Parameter

        from cdrj_ros.nodes.managed import ManagedEstimator

        given = {"robot": ROBOT, "timeout": 3600.0, **given}
        overrides = [Parameter(key, value=value) for key, value in given.items()]
        self.bench, self.node = bench, ManagedEstimator(parameter_overrides=overrides)
        self.node.outputs = []
        configure = self.node._configure

        def configure_and_remember() -> None:
            configure()
            publish = self.node.topics.publish

            def remember(output: Any) -> None:
                self.node.outputs.append(output)
                publish(output)

            self.node.topics.publish = remember

        self.node._configure = configure_and_remember
        bench.executor.add_node(self.node)
        bench.estimators.append(self.node)

    def change(self, label: str = "", number: int = 0) -> bool:
        """Ask for a transition by its label or its number; True if it has been made."""
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState

        request = ChangeState.Request(transition=Transition(id=number, label=label))
        return bool(self.bench.call(ChangeState, "/cdrj/estimator/change_state", request).success)

    @property
    def state(self) -> str:
        from lifecycle_msgs.srv import GetState

        answer = self.bench.call(GetState, "/cdrj/estimator/get_state", GetState.Request())
        return str(answer.current_state.label)

    def feed(self, first: int, last: int) -> None:
        """Give the node samples as its subscriptions would."""
        for kind, one in zip(("motor", "joint"), self.node.inputs, strict=True):
            setattr(self.node, kind, self.node._listener(f"{kind}s", one.heard))
        feed(self.node, first, last)

    def ends(self) -> tuple[int, int]:
        """Numbers of open outputs and of subscribed inputs."""
        graph = self.bench.node
        return (
            sum(graph.count_publishers(f"/cdrj/{topic}") for topic in OUTPUTS),
            sum(graph.count_subscribers(f"/cdrj/{topic}") for topic in INPUTS),
        )


@pytest.fixture
def bench(ros: None) -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def managed(bench: Bench) -> Callable[..., Managed]:
    return lambda **given: Managed(bench, **given)


def test_configure_opens_outputs_activate_opens_inputs_and_the_way_back_closes_them(
    bench: Bench, managed: Callable[..., Managed]
) -> None:
    one = managed()
    for _ in range(2):
        for label, state, ends in (
            ("configure", "inactive", (4, 0)),
            ("activate", "active", (4, 2)),
            ("deactivate", "inactive", (4, 0)),
            ("cleanup", "unconfigured", (0, 0)),
        ):
            assert one.change(label)
            assert one.state == state
            assert bench.until(lambda: one.ends() == ends), (state, one.ends())  # noqa: B023


@pytest.mark.parametrize("before", [(), ("configure",), ("configure", "activate")])
def test_shutdown_ends_every_state(
    bench: Bench, managed: Callable[..., Managed], before: tuple[str, ...]
) -> None:
    one = managed()
    assert all(one.change(label) for label in before)
    assert one.change("shutdown")
    assert one.state == "finalized"
    assert bench.until(lambda: one.ends() == (0, 0))


def test_a_transition_that_the_state_does_not_have_is_refused(
    managed: Callable[..., Managed],
) -> None:
    one = managed()
    assert not one.change("activate")
    assert not one.change(number=4)
    assert not one.change("launch")
    assert one.state == "unconfigured"
    assert one.change("configure")
    assert not one.change("configure")
    assert one.state == "inactive"


def test_an_active_node_estimates_as_an_unmanaged_one(managed: Callable[..., Managed]) -> None:
    one = managed()
    assert one.change("configure")
    assert one.change("activate")
    one.feed(0, 300)
    assert np.array_equal(tensions(one.node), expected((load_model(ROBOT),), (range(300),)))


def test_deactivate_publishes_stale_and_activate_continues_the_friction_history(
    bench: Bench, managed: Callable[..., Managed]
) -> None:
    from cdrj_msgs.msg import CableTensions

    one = managed(tracking_bandwidth=0.0)
    assert one.change("configure")
    said: list[Any] = []
    bench.node.create_subscription(CableTensions, "/cdrj/tensions", said.append, 1000)
    assert bench.until(lambda: one.node.topics.tensions.get_subscription_count() == 1)
    assert one.change("activate")
    one.feed(0, 300)
    assert bench.until(lambda: len(said) == 300)
    assert one.change("deactivate")
    assert bench.until(lambda: len(said) == 301)
    assert all(status & STALE for status in said[-1].status)
    assert not any(status & STALE for status in said[-2].status)

    assert one.change("activate")
    one.feed(300, 400)
    model = load_model(ROBOT)
    state, whole = initial_state(model), []
    for k in range(400):
        state, estimate = step(model, state, sample_at(k))
        whole.append(estimate.tension.copy())
    assert np.array_equal(tensions(one.node), whole)


def test_a_robot_that_cannot_be_loaded_leaves_the_node_unconfigured_until_it_is_corrected(
    managed: Callable[..., Managed],
) -> None:
    from rclpy.parameter import Parameter

    one = managed(robot="nowhere.yaml")
    assert not one.change("configure")
    assert one.state == "unconfigured"
    corrected = [Parameter("robot", value=ROBOT), Parameter("timeout", value=2)]
    assert all(result.successful for result in one.node.set_parameters(corrected))
    assert one.change("configure")
    assert one.node.timeout_s == 2.0
    (result,) = one.node.set_parameters([Parameter("timeout", value=3.0)])
    assert not result.successful
    assert "timeout can only change while unconfigured" in result.reason
    (result,) = one.node.set_parameters([Parameter("friction.rho", value=0.4)])
    assert result.successful


def test_cleanup_returns_to_the_given_preload_and_friction(
    bench: Bench, managed: Callable[..., Managed]
) -> None:
    from cdrj_msgs.srv import SetPreload

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


def test_diagnostics_tell_the_state(bench: Bench, managed: Callable[..., Managed]) -> None:
    said: list[Any] = []
    hear_diagnostics(bench, said)
    one = managed()
    assert bench.until(lambda: one.node.diagnostics.get_subscription_count() == 1)

    def status() -> Any:
        said.clear()
        one.node._on_diagnostics()
        assert bench.until(lambda: bool(said))
        return said[0]

    unconfigured = status()
    assert "configure loads it" in unconfigured.message
    assert one.change("configure")
    inactive = status()
    assert inactive.message.startswith("inactive: no estimates")
    assert inactive.hardware_id == "prototype"
    assert one.change("activate")
    one.feed(0, 100)
    active = status()
    assert active.message == "estimating"
    assert one.change("shutdown")
    states = [
        values_of(found)["lifecycle state"] for found in (unconfigured, inactive, active, status())
    ]
    assert states == ["unconfigured", "inactive", "active", "finalized"]
