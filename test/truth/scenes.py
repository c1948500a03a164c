"""Scenes: a robot and its motion, and the tensions of cables with contact cells on its bodies.

The paths of the cables are those of ``reference_in_space``, which the core's equal to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from model.reference_in_space import by_positions, moved, path_at
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from cdrj_ros.robot.description import Pulley, Robot, Winch
from truth.surface import Cable, Contact, Course, solve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """Tensions and efforts over time."""

    tension: Array
    """Of all elements [N], shape (n, elements)."""
    joint_effort: Array
    """[N m] or [N], shape (n, joints)."""
    motor_effort: Array
    """[N m], shape (n, motors)."""


@dataclass(frozen=True)
class Lines:
    """One cable over time."""

    length: Array
    """Of its elements, with the arcs and what tangents have laid onto its ends [m]."""
    arm: Array
    """Lever arms of its elements about the joints [m], shape (n, elements, joints)."""
    drum: Array
    """Lever arms about its ends [m], shape (n, 2)."""
    courses: tuple[Course, ...]


@dataclass(frozen=True)
class Scene:
    """A robot and its motion; it begins in the reference pose."""

    robot: Robot
    time: Array
    """[s], shape (n,)."""
    joint: Array
    """[rad] or [m], shape (n, joints)."""
    pull: Mapping[str, Array]
    """Cable that a motor winds beyond what its cable's geometry asks for [m], shape (n,)."""
    cycle: float
    """Time after which every body has slipped [s]."""
    stride: int = 4
    """From one sample whose path is computed to the next; 1 where the cable leaves a body."""
    cell: float = np.radians(1.5)
    """Angle of a contact cell about a body [rad]."""

    @cached_property
    def motor(self) -> Array:
        """Angles of the motors [rad], shape (n, motors)."""
        return np.stack([self._drive(motor.name)[0] for motor in self.robot.motors], axis=1)

    def _drive(self, name: str) -> tuple[Array, int, int, Winch]:
        """Angles of a motor, the cable on it, which end of that, and its drum there."""
        for c, cable in enumerate(self.robot.cables):
            for end in (0, -1):
                drum = cable.nodes[end]
                if isinstance(drum, Winch) and drum.motor == name:
                    length = self.lines[c].length.sum(1)
                    wound = self.pull[name] - (length - length[0])
                    return drum.winding * wound / drum.radius, c, end, drum
        raise AssertionError(name)

    @cached_property
    def lines(self) -> tuple[Lines, ...]:
        """All cables over time, the motors at rest."""
        return tuple(self._lines(c) for c in range(len(self.robot.cables)))

    def _lines(self, c: int) -> Lines:
        robot = replace(self.robot, cables=self.robot.cables[c : c + 1])
        (cable,) = robot.cables
        knots = np.unique(np.append(np.arange(0, self.time.size, self.stride), self.time.size - 1))
        poses = self.joint[knots]
        found = [by_positions(robot, cable, q) for q in poses]
        ways = [np.zeros(len(cable.pulleys))]
        ways += [moved(robot, before, now) for before, now in pairwise(poses)]
        paths = [path_at(robot, cable, q).contacts[1:-1] for q in poses]
        touching = np.array([[one.touches for one in path] for path in paths])
        if self.stride > 1:
            assert touching.all()
            touching = np.ones((self.time.size, len(cable.pulleys)), dtype=bool)

        def throughout(values: list[Array]) -> Array:
            return np.asarray(CubicSpline(self.time[knots], np.array(values))(self.time))

        length, arc, laid = (
            throughout([getattr(one, name) for one in found]) for name in ("length", "arc", "laid")
        )
        span = length.copy()
        span[:, :-1] -= 0.5 * arc
        span[:, 1:] -= 0.5 * arc
        span[:, [0, -1]] -= laid
        for b in reversed(range(len(cable.pulleys))):  # the line past a body is that before it
            passed = np.where(touching[:, b], 0.0, span[:, b + 1])
            span[:, b] += passed
            span[:, b + 1] -= passed
        middle = throughout(list(np.cumsum(ways, axis=0)))
        wrap = throughout([one.wrap for one in found])
        courses = map(
            Course, span, middle - 0.5 * arc, middle + 0.5 * arc, wrap, touching, laid
        )  # fmt: skip
        arm, drum = (throughout([getattr(one, name) for one in found]) for name in ("arm", "drum"))
        return Lines(length, arm, drum, tuple(courses))

    def truth(self) -> Truth:
        """Solve all cables over time."""
        drums = [np.zeros((self.time.size, 2)) for _ in self.lines]
        drives = [self._drive(motor.name) for motor in self.robot.motors]
        for angle, c, end, drum in drives:
            drums[c][:, end] = drum.winding * drum.radius * angle
        tensions = [self._tension(c, wound) for c, wound in enumerate(drums)]
        joint_effort = -sum(
            np.einsum("ne,nej->nj", tension, line.arm)
            for tension, line in zip(tensions, self.lines, strict=True)
        )
        motor_effort = [
            -drum.winding * self.lines[c].drum[:, end] * tensions[c][:, end]
            for _, c, end, drum in drives
        ]
        return Truth(
            np.concatenate(tensions, axis=1), np.asarray(joint_effort),
            np.stack(motor_effort, axis=1),
        )  # fmt: skip

    def _tension(self, c: int, wound: Array) -> Array:
        """Of all elements of a cable [N], shape (n, elements); ``wound`` by the motors [m]."""
        cable = self.robot.cables[c]
        contacts = tuple(map(self._contact, cable.pulleys))
        known = Cable(cable.axial_stiffness, cable.preload, contacts)
        courses = (
            replace(course, wound=course.wound + turned)
            for course, turned in zip(self.lines[c].courses, wound, strict=True)
        )
        return np.stack([state.tension(known) for state in solve(known, courses)])

    def _contact(self, node: Pulley) -> Contact:
        assert node.place is not None
        mu, place = node.friction.mu_c, node.place
        if place.kind == "sheath":
            bend = float(node.wrap[0].value[0])
            return Contact(mu, float(place.length / np.ceil(bend / self.cell)))
        return Contact(mu, self.cell * node.radius)


def waves(time: Array, *terms: tuple[float, float, float]) -> Array:
    """A sum of sines that begins at 0, from (amplitude, frequency [Hz], phase [rad]) each."""
    angle = np.zeros(time.size)
    for amplitude, frequency, phase in terms:
        angle += amplitude * (np.sin(2.0 * np.pi * frequency * time + phase) - np.sin(phase))
    return angle
