"""Publication of the estimated angles of joints without encoder."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import JointState

from cdrj_ros.estimation.estimator import Angles
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.messages.templates import Template
from cdrj_ros.messages.topics import JOINT_ANGLES


class JointAngles:
    """Publishes angles and standard deviations as positions of two JointState topics."""

    def __init__(
        self, names: tuple[str, ...], frame_id: str, publisher: Callable[[Any, str], Any]
    ) -> None:
        """Open the topics.

        Args:
            names: of the joints without encoder.
            frame_id: frame of the headers.
            publisher: opens a topic, given the class of its messages and its name.
        """
        self._message = Template(JOINT_STATE, names, ("position",), frame_id)
        self._on_angles = publisher(JointState, JOINT_ANGLES)
        self._on_stddevs = publisher(JointState, f"{JOINT_ANGLES}_stddev")

    @property
    def publishers(self) -> tuple[Any, Any]:
        """The publishers, to be destroyed by the node."""
        return self._on_angles, self._on_stddevs

    def publish(self, stamp_ns: int, angles: Angles) -> None:
        """Publish the last angles; nothing while they are unknown."""
        encode = self._message.encode
        self._on_angles.publish(encode(stamp_ns, position=angles.value[-1]))
        self._on_stddevs.publish(encode(stamp_ns, position=angles.stddev[-1]))
