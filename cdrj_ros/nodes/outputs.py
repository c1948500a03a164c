"""The topics on which the estimator publishes."""

from __future__ import annotations

from typing import Any, Final

from cdrj_msgs.msg import CableTensions, NodalForces
from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState

from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import (
    EstimateEncoder,
    KnownEfforts,
    Template,
    known_elements,
    marked_stale,
)
from cdrj_ros.messages.topics import (
    EFFORTS,
    JOINT_ANGLES,
    NODAL_FORCES,
    TENSION_STATES,
    TENSIONS,
    WRENCHES,
)
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.settings import default_profile

LOOK_S: Final = 0.2
"""Time between two counts of the subscribers of outputs that are computed on request [s]."""


class Outputs:
    """Publishes estimates.

    Tensions, nodal forces and efforts are always published.  Tensions as a JointState, standard
    deviations of efforts, and the force on a pulley as a WrenchStamped are computed while somebody
    subscribes; the topic of a wrench is opened for its first subscriber.
    """

    def __init__(self, node: Node, live: LiveEstimator, frame_id: str) -> None:
        """Open the topics.

        Args:
            node: the node that publishes.
            live: provides the names, and whether there are standard deviations.
            frame_id: name of the robot's base frame; empty: that of the robot file.
        """
        self._node, self._model = node, live.model
        layout, uncertain = live.model.layout.in_frame(frame_id), live.options.uncertainty
        self.published = 0
        """Number of estimates published."""
        self._encoder = EstimateEncoder(layout, uncertain, live.model.touched)
        self._states = KnownEfforts(layout.elements, layout.base_link)
        self._frames = _frames(live.model, layout.base_link)
        self._opened: list[Any] = []
        self.tensions = self._open(CableTensions, TENSIONS)
        self.forces = self._open(NodalForces, NODAL_FORCES)
        self.efforts = self._open(JointState, EFFORTS)
        self.efforts_stddev = self._open(JointState, f"{EFFORTS}_stddev")
        self.states = self._open(JointState, TENSION_STATES)
        self._angles: Template | None = None
        if live.encoderless is not None:
            names = live.encoderless.solver.names
            self._angles = Template(JOINT_STATE, names, ("position",), layout.base_link)
            self._on_angles = self._open(JointState, JOINT_ANGLES)
            self._on_angles_stddev = self._open(JointState, f"{JOINT_ANGLES}_stddev")
        self._wrenches: dict[int, Any] = {}
        """Publishers of the forces on pulleys, by index of the pulley."""
        self._topics = {
            node.resolve_topic_name(f"{WRENCHES}/{pulley.replace('/', '_')}"): k
            for k, pulley in enumerate(layout.pulleys)
        }
        self.wanted: list[int] = []
        """Pulleys whose wrenches have subscribers."""
        self.states_wanted = self.stddev_wanted = False
        self._timer = node.create_timer(
            LOOK_S, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _open(self, message: Any, topic: str) -> Any:
        publisher = self._node.create_publisher(
            message,
            topic,
            default_profile(),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._opened.append(publisher)
        return publisher

    def close(self) -> None:
        """Close the topics."""
        self._node.destroy_timer(self._timer)
        for publisher in self._opened:
            self._node.destroy_publisher(publisher)

    def _look(self) -> None:
        """Find out which outputs have subscribers."""
        for topic, _ in self._node.get_topic_names_and_types():
            k = self._topics.get(topic)
            if k is not None and k not in self._wrenches:
                self._wrenches[k] = self._node.create_publisher(
                    WrenchStamped, topic, default_profile()
                )
                self._opened.append(self._wrenches[k])
        self.wanted = [k for k, one in self._wrenches.items() if one.get_subscription_count()]
        self.states_wanted = self.states.get_subscription_count() > 0
        self.stddev_wanted = self.efforts_stddev.get_subscription_count() > 0

    def publish(self, estimate: Estimate) -> None:
        """Publish an estimate on all topics."""
        stamp, angles = estimate.stamp_ns, estimate.angles
        if self._angles is not None and angles is not None:
            encode = self._angles.encode
            self._on_angles.publish(encode(stamp, position=angles.value[-1]))
            self._on_angles_stddev.publish(encode(stamp, position=angles.stddev[-1]))
        tensions, forces, efforts = self._encoder.encode(estimate)
        self.tensions.publish(tensions)
        self.forces.publish(forces)
        self.efforts.publish(efforts)
        if self.stddev_wanted and estimate.stddev is not None:
            self.efforts_stddev.publish(self._encoder.efforts_stddev(estimate))
        if self.states_wanted or self.wanted:
            self._publish_known(estimate)
        self.published += 1

    def publish_stale(self, estimate: Estimate) -> None:
        """Publish tensions and nodal forces once more, as STALE."""
        tensions, forces, _ = self._encoder.encode(marked_stale(estimate))
        self.tensions.publish(tensions)
        self.forces.publish(forces)

    def _publish_known(self, estimate: Estimate) -> None:
        """Publish what has no status: nothing of an estimate that is STALE or INVALID."""
        layout, known = self._model.layout, known_elements(estimate)
        if self.states_wanted and known.any():
            self.states.publish(self._states.encode(estimate.stamp_ns, estimate.tension, known))
        force = [estimate.values[part] for part in (layout.force_x, layout.force_y, layout.force_z)]
        for k in self.wanted:
            if not known[layout.element_before[k]]:
                continue
            message = WrenchStamped()
            message.header.frame_id = self._frames[k]
            stamp, vector = message.header.stamp, message.wrench.force
            stamp.sec, stamp.nanosec = divmod(estimate.stamp_ns, 1_000_000_000)
            vector.x, vector.y, vector.z = (float(part[k]) for part in force)
            self._wrenches[k].publish(message)


def _frames(model: Model, base: str) -> list[str]:
    """Frame of every pulley's force, see NodalForces.msg: the base frame, or the pulley's own."""
    cables = {cable.name: cable for cable in model.robot.cables}
    frames = []
    for pulley in model.layout.pulleys:
        cable = cables[pulley.rpartition("/")[0]]
        frames.append(base if cable.placed else pulley.replace("/", "_"))
    return frames


class RateLimit:
    """Selects the estimates that are published, by a maximum rate of their stamps.

    The friction state depends on the path of the cable, so every sample is computed: skipping
    samples would change the estimates.  Skipping messages changes no bit of the published ones.
    """

    def __init__(self, rate_hz: float) -> None:
        """Publish at most ``rate_hz`` estimates per second of the stamps; 0: all."""
        self._interval_ns = round(1e9 / rate_hz) if rate_hz > 0.0 else 0
        self.reset()

    def reset(self) -> None:
        """Let the next estimate pass."""
        self._due_ns = 0

    def passes(self, stamp_ns: int) -> bool:
        """Whether to publish the estimate of this stamp [ns]; call once for each, in order."""
        before_ns = self._due_ns - self._interval_ns  # further back, the clock has jumped
        if before_ns <= stamp_ns < self._due_ns:
            return False
        # due times lie on a fixed grid so that jitter does not lower the rate; a gap restarts it
        self._due_ns += self._interval_ns
        if not stamp_ns < self._due_ns <= stamp_ns + self._interval_ns:
            self._due_ns = stamp_ns + self._interval_ns
        return True
