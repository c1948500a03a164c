"""Scenes: a robot and its motion, as truth and as robot file, from the same numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from truth.bodies import Node
from truth.frames import Frame, Pose, place
from truth.paths import Path, find_path
from truth.surface import Cable, Contact, Course, State, solve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """A cable of a scene."""

    name: str
    stiffness: float
    """EA [N]."""
    preload: float
    nodes: tuple[Node, ...]

    @property
    def spans(self) -> tuple[str, ...]:
        """Names of its spans, those of the estimator's elements."""
        return tuple(f"{self.name}/{k}" for k in range(1, len(self.nodes)))


@dataclass(frozen=True)
class Truth:
    """Tensions and efforts over time."""

    tension: Array
    """Of every cable's straight spans [N], shape (n, spans)."""
    joint_effort: Array
    """Of the forces of the spans on the bodies that they leave [N m] or [N], (n, joints)."""
    motor_effort: Array
    """[N m], shape (n, motors)."""


@dataclass(frozen=True)
class Scene:
    """A robot and its motion; it begins in the reference pose."""

    name: str
    frames: tuple[Frame, ...]
    joints: tuple[str, ...]
    motors: tuple[str, ...]
    lines: tuple[Line, ...]
    time: Array
    """[s], shape (n,)."""
    joint: Array
    """[rad] or [m], shape (n, joints)."""
    pull: Mapping[str, Array]
    """Cable that a motor winds beyond what its cable's geometry asks for [m], shape (n,)."""
    cycle: float
    """Time after which every body has slipped [s]."""
    cell_deg: float = 1.5
    """Angle of a contact cell about a body."""

    @cached_property
    def poses(self) -> Mapping[str, Pose]:
        """Of all frames over time."""
        return place(self.frames, self.joints, self.joint)

    @cached_property
    def paths(self) -> tuple[Path, ...]:
        """Of all cables over time."""
        return tuple(find_path(line.nodes, self.poses) for line in self.lines)

    @cached_property
    def motor(self) -> Array:
        """Angles of the motors [rad], shape (n, motors)."""
        angle = np.zeros((self.time.size, len(self.motors)))
        for line, path in zip(self.lines, self.paths, strict=True):
            for node in (line.nodes[0], line.nodes[-1]):
                if node.motor:
                    longer = path.length - path.length[0]
                    wound = self.pull[node.motor] - longer
                    angle[:, self.motors.index(node.motor)] = node.winding * wound / node.radius
        return angle

    def robot_file(self, cells: int = 0) -> str:
        """The same robot as text of a robot file, with so many cells a body unless it is 0."""
        return yaml.safe_dump(self._document(cells), sort_keys=False)

    def _document(self, cells: int) -> dict[str, Any]:
        low, high = self.joint.min(0), self.joint.max(0)
        margin = 0.01 * (high - low) + 1e-9
        joints = [
            {
                "name": name,
                "range": [float(low[j] - margin[j]), float(high[j] + margin[j])],
                "reference_angle": float(self.joint[0, j]),
            }
            for j, name in enumerate(self.joints)
        ]
        return {
            "name": self.name,
            "motors": [{"name": name} for name in self.motors],
            "joints": joints,
            "frames": [_frame(frame) for frame in self.frames],
            "friction": {"law": "elastoplastic", "rho": 1.0, "bristle_stiffness": 1e6},
            "cables": [
                {
                    "name": line.name,
                    "axial_stiffness": line.stiffness,
                    "preload": line.preload,
                    "nodes": [_node(node, cells) for node in line.nodes],
                }
                for line in self.lines
            ],
        }

    def states(self, c: int) -> tuple[Cable, Iterator[State]]:
        """Cable c and its states, one after the other."""
        line, path = self.lines[c], self.paths[c]
        cell = np.radians(self.cell_deg)
        contacts = tuple(_contact(node, cell) for node in line.nodes[1:-1])
        drums = path.wound.copy()
        for end in (0, -1):
            node = line.nodes[end]
            if node.motor:
                turned = self.motor[:, self.motors.index(node.motor)]
                drums[:, end] += node.winding * node.radius * turned
        cable = Cable(line.stiffness, line.preload, contacts)
        courses = map(
            Course, path.span, path.first, path.last, path.wrap, path.touching, drums
        )  # fmt: skip
        return cable, solve(cable, courses)

    def truth(self) -> Truth:
        """Solve all cables over time."""
        tensions = [
            np.stack([state.tension(cable) for state in states])
            for cable, states in map(self.states, range(len(self.lines)))
        ]
        joint_effort, motor_effort = self._joint_effort(tensions), self._motor_effort(tensions)
        return Truth(np.concatenate(tensions, axis=1), joint_effort, motor_effort)

    def _joint_effort(self, tensions: Sequence[Array]) -> Array:
        """The pull of every span on the body that it leaves and on the one that it meets."""
        effort = np.zeros(self.joint.shape)
        for line, path, tension in zip(self.lines, self.paths, tensions, strict=True):
            for k in range(len(line.nodes) - 1):
                begin = self.poses[_exit_frame(line.nodes[k])].velocity(
                    path.begin[:, k], len(self.joints)
                )
                end = self.poses[line.nodes[k + 1].frame].velocity(path.end[:, k], len(self.joints))
                pull = tension[:, k, None] * path.direction[:, k]
                effort += np.einsum("njx,nx->nj", begin - end, pull)
        return effort

    def _motor_effort(self, tensions: Sequence[Array]) -> Array:
        """The moment of the pull on every drum; a point has the drum's radius for its lever."""
        effort = np.zeros((self.time.size, len(self.motors)))
        for line, path, tension in zip(self.lines, self.paths, tensions, strict=True):
            for end, points in ((0, path.begin[:, 0]), (-1, path.end[:, -1])):
                node = line.nodes[end]
                if node.motor:
                    lever = np.full(self.time.size, node.radius)
                    if not node.is_point:
                        pose = self.poses[node.frame]
                        axis = np.asarray(node.axis or (0.0, 0.0, 1.0))
                        out = points - pose.point((*node.position, 0.0)[:3])
                        moment = np.cross(out, path.direction[:, end])
                        lever = node.turn * np.sum(moment * (pose.turn @ axis), -1)
                        lever /= np.linalg.norm(axis)
                    pull = node.winding * lever * tension[:, end]
                    effort[:, self.motors.index(node.motor)] -= pull
        return effort


def _exit_frame(node: Node) -> str:
    return node.exit_frame if node.kind == "sheath" else node.frame


def _contact(node: Node, cell: float) -> Contact:
    if node.kind == "eyelet":
        return Contact(node.mu, 0.0)
    if node.kind == "sheath":
        return Contact(node.mu, float(node.length / np.ceil(node.bend / cell)))
    return Contact(node.mu, cell * node.radius)


def _frame(frame: Frame) -> dict[str, Any]:
    return {
        "name": frame.name, "parent": frame.parent, "motion": frame.motion, "joint": frame.joint,
        "origin": [*map(float, frame.origin)], "rpy": [*map(float, frame.rpy)],
        "axis": [*map(float, frame.axis)],
    }  # fmt: skip


def _node(node: Node, cells: int) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "type": node.kind, "frame": node.frame, "position": [*map(float, node.position)],
    }  # fmt: skip
    if node.radius:
        entry["radius"] = node.radius
    if node.axis is not None:
        entry["axis"] = [*map(float, node.axis)]
    if node.turn:
        entry["turn"] = "ccw" if node.turn > 0 else "cw"
    if node.side is not None:
        entry["side"] = [*map(float, node.side)]
    if node.motor:
        entry |= {"motor": node.motor, "winding": node.winding}
    if node.kind == "sheath":
        entry |= {"exit": [*map(float, node.exit)], "exit_frame": node.exit_frame}
        entry |= {"length": node.length, "bend": float(node.bend)}
    if node.kind not in {"winch", "anchor"}:
        entry["friction"] = {"mu_c": node.mu}
        if cells and node.kind != "eyelet":
            entry["cells"] = cells
    return entry


def waves(time: Array, *terms: tuple[float, float, float]) -> Array:
    """A sum of sines that begins at 0, from (amplitude, frequency [Hz], phase [rad]) each."""
    angle = np.zeros(time.size)
    for amplitude, frequency, phase in terms:
        angle += amplitude * (np.sin(2.0 * np.pi * frequency * time + phase) - np.sin(phase))
    return angle
