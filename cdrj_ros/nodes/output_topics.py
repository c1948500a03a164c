"""The topics on which the estimator publishes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cdrj_msgs.msg import CableTensions, NodalForces
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState

from cdrj_ros.estimation.session import LiveEstimator, Output
from cdrj_ros.messages.conversions import marked_stale
from cdrj_ros.messages.estimate_encoder import EstimateEncoder
from cdrj_ros.messages.topics import EFFORTS, NODAL_FORCES, TENSIONS
from cdrj_ros.nodes.qos import default_profile
from cdrj_ros.nodes.settings import Started

if TYPE_CHECKING:
    from cdrj_ros.nodes.extra_outputs import ExtraOutputs
    from cdrj_ros.nodes.joint_angles import JointAngles


class OutputTopics:
    """Publishes estimates: tensions, nodal forces and efforts, and what was asked for."""

    def __init__(self, node: Node, live: LiveEstimator, started: Started) -> None:
        """Open the topics.

        Args:
            node: the node that publishes.
            live: provides the names, and whether there are standard deviations.
            started: provides the frame and the outputs on request.
        """
        self._node = node
        model, uncertain = live.model, live.options.uncertainty
        self.published = 0
        """Number of estimates published."""
        self._encoder = EstimateEncoder(model.layout, started.frame_id, uncertain=uncertain)
        self.tensions = self._publisher(CableTensions, TENSIONS)
        self.forces = self._publisher(NodalForces, NODAL_FORCES)
        self.efforts = self._publisher(JointState, EFFORTS)
        self.efforts_stddev = self._publisher(JointState, "efforts_stddev") if uncertain else None
        self._angles: JointAngles | None = None
        if live.encoderless is not None:
            from cdrj_ros.nodes.joint_angles import JointAngles

            self._angles = JointAngles(
                live.encoderless.solver.names, started.frame_id, self._publisher
            )
        self.extra: ExtraOutputs | None = None
        """The outputs on request, if there are any."""
        if started.tension_states or started.wrenches:
            from cdrj_ros.nodes.extra_outputs import ExtraOutputs

            self.extra = ExtraOutputs(
                node,
                model,
                started.frame_id,
                tension_states=started.tension_states,
                wrenches=started.wrenches,
            )

    def _publisher(self, message: Any, topic: str) -> Any:
        return self._node.create_publisher(
            message,
            topic,
            default_profile(),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def publish(self, output: Output) -> None:
        """Publish an estimate on all topics."""
        estimate, stddev, _ = output
        if self._angles is not None and output.angles is not None:
            self._angles.publish(estimate.stamp_ns, output.angles)
        tensions, forces, efforts = self._encoder.encode(estimate, stddev)
        self.tensions.publish(tensions)
        self.forces.publish(forces)
        self.efforts.publish(efforts)
        on_efforts = self.efforts_stddev
        if on_efforts is not None and stddev is not None and on_efforts.get_subscription_count():
            on_efforts.publish(self._encoder.efforts_stddev(estimate, stddev))
        if self.extra is not None:
            self.extra.publish(estimate)
        self.published += 1

    def publish_stale(self, output: Output) -> None:
        """Publish tensions and nodal forces once more, as STALE."""
        tensions, forces, _ = self._encoder.encode(marked_stale(output.estimate), output.stddev)
        self.tensions.publish(tensions)
        self.forces.publish(forces)

    def close(self) -> None:
        """Close the topics."""
        angles = () if self._angles is None else self._angles.publishers
        own = (self.tensions, self.forces, self.efforts, self.efforts_stddev)
        for publisher in (*own, *angles):
            if publisher is not None:
                self._node.destroy_publisher(publisher)
        if self.extra is not None:
            self.extra.close()
