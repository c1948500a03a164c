"""Outputs on request: tensions as a JointState, and every pulley's force as a WrenchStamped."""

from __future__ import annotations

from typing import Any, Final

from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.messages.topics import TENSION_STATES, WRENCHES
from cdrj_ros.model.prepared import Model
from cdrj_ros.model.status import STALE
from cdrj_ros.nodes.qos import default_profile

LOOK_S: Final = 0.1
"""Time between two counts of the subscribers [s]."""

BASE: Final = "base"
"""Frame of forces in the base frame unless the parameter frame_id names it."""


class ExtraOutputs:
    """Publishes those outputs that have subscribers; computes nothing for the others."""

    def __init__(
        self, node: Node, model: Model, frame_id: str, *, tension_states: bool, wrenches: bool
    ) -> None:
        """Open the requested topics.

        Args:
            node: the node that publishes.
            model: provides names and the layout of the estimates.
            frame_id: frame of the header, and of forces in the base frame.
            tension_states: whether to publish the tensions as JointState: names are the elements,
                efforts the tensions [N].
            wrenches: whether to publish the force on every pulley [N], one topic each.
        """
        self._node, self._layout = node, model.layout
        self._states = Template(JOINT_STATE, model.layout.elements, ("effort",), frame_id)
        self._on_states: Any = None
        self._on_wrenches: list[tuple[int, Any, WrenchStamped]] = []
        if tension_states:
            self._on_states = node.create_publisher(JointState, TENSION_STATES, default_profile())
        if wrenches:
            frames = _frames(model, frame_id or BASE)
            for k, pulley in enumerate(model.layout.pulleys):
                topic = f"{WRENCHES}/{pulley.replace('/', '_')}"
                message = WrenchStamped()
                message.header.frame_id = frames[k]
                publisher = node.create_publisher(WrenchStamped, topic, default_profile())
                self._on_wrenches.append((k, publisher, message))
        self._wanted: list[tuple[int, Any, WrenchStamped]] = []
        self._states_wanted = False
        self._timer = node.create_timer(
            LOOK_S, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _look(self) -> None:
        """Find out which topics have subscribers."""
        self._wanted = [one for one in self._on_wrenches if one[1].get_subscription_count()]
        states = self._on_states
        self._states_wanted = states is not None and states.get_subscription_count() > 0

    def publish(self, estimate: Estimate) -> None:
        """Publish an estimate; nothing if it is STALE or INVALID, which no message could tell."""
        if not (self._wanted or self._states_wanted) or not estimate.solved:
            return
        if int(estimate.status[0]) & STALE:  # then all are
            return
        values, layout = estimate.values, self._layout
        if self._states_wanted:
            tension = values[layout.tension]
            self._on_states.publish(self._states.encode(estimate.stamp_ns, effort=tension))
        if self._wanted:
            sec, nanosec = divmod(estimate.stamp_ns, 1_000_000_000)
            x, y, z = values[layout.force_x], values[layout.force_y], values[layout.force_z]
            for k, publisher, message in self._wanted:
                message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
                force = message.wrench.force
                force.x, force.y, force.z = float(x[k]), float(y[k]), float(z[k])
                publisher.publish(message)

    def close(self) -> None:
        """Close the topics."""
        self._node.destroy_timer(self._timer)
        for _, publisher, _ in self._on_wrenches:
            self._node.destroy_publisher(publisher)
        if self._on_states is not None:
            self._node.destroy_publisher(self._on_states)


def _frames(model: Model, base: str) -> list[str]:
    """Frame of every pulley's force, see NodalForces.msg: the base frame, or the pulley's own."""
    cables = {cable.name: cable for cable in model.robot.cables}
    frames = []
    for pulley in model.layout.pulleys:
        cable = cables[pulley.rpartition("/")[0]]
        placed = cable.routed or cable.spatial
        frames.append(base if placed else pulley.replace("/", "_"))
    return frames
