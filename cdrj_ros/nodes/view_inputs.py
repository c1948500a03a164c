"""The last messages of an estimator, heard only while somebody looks at a picture."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import inf
from time import monotonic
from typing import Any, Final

import numpy as np
from cdrj_msgs.msg import CableTensions, NodalForces
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from cdrj_ros.messages import topics
from cdrj_ros.model.packing import STALE
from cdrj_ros.model.prepared import Model
from cdrj_ros.nodes.feed import LastMessage
from cdrj_ros.view.history import (
    Snapshot,
    joint_angles,
    joint_axes,
    nothing_known,
    pulley_columns,
    tension_columns,
)

SILENCE_S: Final = 0.5
"""Time without tensions or forces after which all of them are shown as STALE [s]."""


class Inputs:
    """Subscriptions that keep the last message of every topic, undecoded until it is drawn."""

    def __init__(self, node: Node, model: Model, references: Sequence[str] = ()) -> None:
        """Remember what to subscribe to.

        Args:
            node: the subscriber.
            model: gives the names of elements, pulleys and joints.
            references: topics of true or measured tensions; the first that has an element counts.
        """
        self._node, self._model, self._references = node, model, tuple(references)
        self._joints = joint_axes(model.robot)
        self._opened: list[Any] = []
        self._heard: dict[str, LastMessage] = {}
        self._shown = nothing_known(model)
        self.count = 0
        """Number of messages with tensions."""
        self.heard_s = -inf
        """Steady time of the last of them [s]."""

    @property
    def listening(self) -> bool:
        """Whether there are subscriptions."""
        return bool(self._opened)

    @property
    def fresh(self) -> bool:
        """Whether tensions are not older than ``SILENCE_S``."""
        return self._fresh(topics.TENSIONS)

    def _fresh(self, topic: str) -> bool:
        found = self._heard.get(topic)
        return found is not None and not found.silent(SILENCE_S)

    def listen(self, wanted: bool) -> bool:
        """Subscribe, or end the subscriptions and forget the messages; returns ``wanted``."""
        if wanted and not self._opened:
            quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            kinds = {
                topics.JOINT_STATES: JointState,
                topics.TENSIONS: CableTensions,
                topics.NODAL_FORCES: NodalForces,
            } | dict.fromkeys(self._references, CableTensions)
            for topic, kind in kinds.items():
                hear = partial(self.hear, topic)
                one = self._node.create_subscription(kind, topic, hear, quality, raw=True)
                self._opened.append(one)
        elif not wanted and self._opened:
            for one in self._opened:
                self._node.destroy_subscription(one)
            self._opened.clear()
            self._heard.clear()
        return wanted

    def hear(self, topic: str, payload: bytes) -> None:
        """Keep a serialised message."""
        self._heard.setdefault(topic, LastMessage()).hear(payload)
        if topic == topics.TENSIONS:
            self.count, self.heard_s = self.count + 1, monotonic()

    def _last(self, kind: Any, topic: str) -> Any:
        found = self._heard.get(topic)
        return None if found is None else deserialize_message(found.payload, kind)

    def snapshot(self) -> Snapshot:
        """The values of the last messages, STALE after ``SILENCE_S``."""
        layout = self._model.layout
        message = self._last(CableTensions, topics.TENSIONS)
        tension, stddev, status = tension_columns(message, layout)
        forces = self._last(NodalForces, topics.NODAL_FORCES)
        force, friction, slip_speed, pulley_status = pulley_columns(forces, layout)
        stamp_ns = self._shown.stamp_ns
        if message is not None:
            stamp = message.header.stamp
            stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        if not self.fresh:
            status = status | np.uint8(STALE)
        if not self._fresh(topics.NODAL_FORCES):
            pulley_status = pulley_status | np.uint8(STALE)
        reference = np.full(len(layout.elements), np.nan)
        for topic in self._references:
            measured, _, _ = tension_columns(self._last(CableTensions, topic), layout)
            reference = np.where(np.isnan(reference), measured, reference)
        joint_states = self._last(JointState, topics.JOINT_STATES)
        self._shown = Snapshot(
            stamp_ns=stamp_ns, tension=tension, stddev=stddev, status=status,
            angle=joint_angles(joint_states, self._joints, self._shown.angle), force=force,
            friction=friction, slip_speed=slip_speed, pulley_status=pulley_status,
            reference=reference,
        )  # fmt: skip
        return self._shown
