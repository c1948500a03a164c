"""The markers node draws what the estimator says, and nothing while nobody subscribes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import monotonic
from typing import Any

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.report.scene import LIMIT_COLOUR, tension_colour

PATIENCE_S = 60.0


@pytest.fixture
def drawing(ros: None) -> Iterator[Callable[..., Any]]:
    """Create a markers node in this process."""
    from rclpy.parameter import Parameter

    from cdrj_ros.nodes.markers import MarkersNode

    opened: list[Any] = []

    def create(**parameters: Any) -> Any:
        given = {"robot": "finger", **parameters}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        opened.append(MarkersNode(parameter_overrides=overrides))
        return opened[-1]

    yield create
    for one in opened:
        one.destroy_node()


def tensions_of(node: Any, tension: float, status: int = 0) -> Any:
    from cdrj_msgs.msg import CableTensions

    names = list(node.model.layout.elements)
    return CableTensions(
        name=names, tension=[tension] * len(names), status=[status] * len(names), stddev=[]
    )


def cables(node: Any) -> list[Any]:
    return [marker for marker in node.picture().markers if marker.ns == "cables"]


def colour(marker: Any) -> tuple[float, float, float]:
    return marker.color.r, marker.color.g, marker.color.b


def test_colour_width_and_line_show_tension_and_status(drawing: Any) -> None:
    from cdrj_msgs.msg import CableTensions as T
    from visualization_msgs.msg import Marker

    node = drawing()
    cable = node.model.robot.cables[0]

    def first(tension: float, status: int = 0) -> Any:
        node._on_tensions(tensions_of(node, tension, status))
        return cables(node)[0]

    taut = first(cable.preload)
    assert colour(taut) == pytest.approx(tension_colour(cable.preload, cable.preload, 150.0))
    assert colour(first(150.0)) == pytest.approx(LIMIT_COLOUR)
    assert first(0.0, T.SLACK).scale.x < 0.5 * taut.scale.x
    assert first(9.0, T.UNSURE).color.a < 0.5 < taut.color.a
    for flag in (T.STALE, T.INVALID):
        assert first(150.0, flag).type == Marker.LINE_LIST
        assert colour(first(150.0, flag)) != pytest.approx(LIMIT_COLOUR)


def test_without_tensions_every_cable_is_dashed(drawing: Any) -> None:
    from visualization_msgs.msg import Marker

    node = drawing()
    assert {marker.type for marker in cables(node)} == {Marker.LINE_LIST}
    assert len(cables(node)) == len(node.model.layout.elements)


def test_the_picture_follows_the_joints_and_ignores_invalid_angles(drawing: Any) -> None:
    from sensor_msgs.msg import JointState

    node = drawing()

    def last_point() -> tuple[float, float]:
        point = cables(node)[4].points[-1]
        return point.x, point.y

    before = last_point()
    node._on_joints(JointState(name=["mcp"], position=[float("nan")]))
    node._on_joints(JointState(name=["mcp"], position=[]))
    node._on_joints(JointState(name=["unknown"], position=[1.0]))
    assert last_point() == before
    node._on_joints(JointState(name=["pip", "mcp"], position=[0.1, 0.6]))
    assert last_point() != before
    np.testing.assert_allclose(node.angles, [0.6, 0.1])


def test_slipping_pulleys_change_colour_and_forces_become_arrows(drawing: Any) -> None:
    from cdrj_msgs.msg import NodalForces
    from visualization_msgs.msg import Marker

    node = drawing(labels=True, force_scale=0.001)
    name = node.model.layout.pulleys[0]

    def hear(speed: float, status: int = 0) -> dict[str, Any]:
        node._on_forces(
            NodalForces(
                name=[name], force_x=[10.0], force_y=[0.0], force_z=[0.0], magnitude=[10.0],
                friction=[0.0], slip_speed=[speed], status=[status],
            )
        )  # fmt: skip
        markers = node.picture().markers
        return {f"{marker.ns}/{marker.id}": marker for marker in markers}

    still, moving = hear(0.0), hear(0.01)
    assert colour(still["wheels/1"]) != colour(moving["wheels/1"])
    start, end = moving["forces/1"].points
    assert end.x - start.x == pytest.approx(0.01)
    assert end.y == pytest.approx(start.y)
    gone = hear(0.01, NodalForces.INVALID)
    assert gone["forces/1"].action == Marker.DELETE
    assert colour(gone["wheels/1"]) == colour(still["wheels/1"])
    assert any(marker.text for marker in moving.values())


def test_nothing_is_drawn_without_a_subscriber(drawing: Any) -> None:
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from visualization_msgs.msg import MarkerArray

    node, user = drawing(), Node("user", namespace="cdrj")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.add_node(user)
    try:
        for _ in range(20):
            executor.spin_once(timeout_sec=0.05)
        assert node.drawn == 0
        heard: list[Any] = []
        user.create_subscription(MarkerArray, "markers", heard.append, 1)
        deadline = monotonic() + PATIENCE_S
        while not heard and monotonic() < deadline:
            executor.spin_once(timeout_sec=0.05)
        assert node.drawn > 0
        assert heard[0].markers
    finally:
        executor.shutdown()
        user.destroy_node()


def test_a_missing_robot_is_refused(drawing: Any) -> None:
    with pytest.raises(UsageError, match="the parameter robot is missing"):
        drawing(robot="")
