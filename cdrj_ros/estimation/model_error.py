"""Standard deviations that the spread of the ensemble does not contain.

These are the error of the model itself, which ``identify`` finds from residuals, and the tension
that a cable may have although its status is SLACK.
See docs/uncertainty.md.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.prepared import Model, Shape, shape_at
from cdrj_ros.robot.description import Robot, Winch

LEAST_ARM: Final = 0.05
"""Moment arms below this fraction of the largest are not used to turn an effort into a tension."""


def unmodelled(model: Model) -> Table:
    """Standard deviations to add to the spread of the members, by column of ``stddev_columns``.

    Returns:
        Shape (2, columns).  Row 0: variance of the model's error (U5).  Row 1: smallest standard
        deviation (U6) of a quantity whose magnitude does not exceed it, so that its cables count
        as slack.
    """
    robot = model.robot
    shape = shape_at(model, robot.reference_pose)
    slack = robot.per_element([cable.slack_tension for cable in robot.cables])
    given = dict(robot.uncertainty.model_error) if robot.uncertainty is not None else {}
    error = _tension_errors(robot, shape, given) if given else np.zeros(slack.size)
    known = _through(robot, shape, error)
    names = [f"tension/{name}" for name in model.layout.elements]
    names += [""] * len(model.layout.pulleys)
    names += [f"effort/{name}" for name in (*model.layout.motors, *model.layout.joints)]
    for k, name in enumerate(names):
        known[k] = given.get(name, known[k])
    return np.stack([known**2, _through(robot, shape, slack)])


def motor_arms(robot: Robot, name: str) -> Vector:
    """Effort on a motor per newton in every element [m], shape (elements,)."""
    arms = []
    for cable in robot.cables:
        own = np.zeros(len(cable.element_names))
        for node, element in ((cable.nodes[0], 0), (cable.nodes[-1], -1)):
            if isinstance(node, Winch) and node.motor == name:
                own[element] = node.radius
        arms.append(own)
    return np.concatenate(arms)


def _joint_arms(shape: Shape, joint: int) -> Vector:
    """Effort on a joint per newton in every element [m], shape (elements,)."""
    arms: Vector = np.abs(shape.lever_arm[:, joint])
    return np.where(arms > LEAST_ARM * max(float(arms.max(initial=0.0)), 1e-300), arms, 0.0)


def stiffness(robot: Robot, shape: Shape) -> Table:
    """Change of every cable's mean tension per change of an angle [N/rad], or [N/m] if it slides.

    Without friction and at high tension; shape (cables, axes).  A cable of length L that an axis
    lengthens by the arm r takes E A r / L per radian.
    """
    motors = [motor_arms(robot, motor.name) for motor in robot.motors]
    arms = np.abs(np.column_stack([*motors, shape.lever_arm]))
    rows = [
        cable.axial_stiffness * arms[own].sum(axis=0) / float(shape.length[own].sum())
        for cable, own in zip(robot.cables, robot.parts, strict=True)
    ]
    return np.stack(rows)


def offset_gain(model: Model) -> Table:
    """Change of every column of ``stddev_columns`` per offset of an encoder (U12), (columns, axes).

    Those of several cables add up, as they do where cables pull against each other.
    """
    robot = model.robot
    shape = shape_at(model, robot.reference_pose)
    per_element = robot.per_element(stiffness(robot, shape))
    return np.stack([_through(robot, shape, one, together=True) for one in per_element.T], axis=1)


def length_share(model: Model) -> Vector:
    """Length of every element by that of its cable, in the reference pose, shape (elements,)."""
    robot = model.robot
    shape = shape_at(model, robot.reference_pose)
    shares = [shape.length[own] / float(shape.length[own].sum()) for own in robot.parts]
    return np.concatenate(shares)


def _tension_errors(robot: Robot, shape: Shape, given: dict[str, float]) -> Vector:
    """Model error of every tension [N]: (U5), shape (elements,).

    The cables that act on an effort share its error.  Along a cable the error is interpolated
    between the elements with given errors, and constant beyond them.  A cable without any has the
    largest error of another one in proportion to its preload: it was not looked at.
    """
    parts = robot.parts
    sources: list[dict[int, float]] = [{} for _ in parts]
    efforts = [(f"effort/{motor.name}", motor_arms(robot, motor.name)) for motor in robot.motors]
    efforts += [
        (f"effort/{joint.name}", _joint_arms(shape, j)) for j, joint in enumerate(robot.joints)
    ]
    for name, arms in efforts:
        acting = [c for c, part in enumerate(parts) if arms[part].any()]
        for c in acting if name in given else ():
            own = arms[parts[c]]
            error = given[name] / (float(own.sum()) * np.sqrt(len(acting)))
            for element in np.flatnonzero(own).tolist():
                sources[c][element] = max(sources[c].get(element, 0.0), error)
    for c, cable in enumerate(robot.cables):
        for element, name in enumerate(cable.element_names):
            if f"tension/{name}" in given:
                sources[c][element] = given[f"tension/{name}"]
    worst = max(
        (max(own.values()) / cable.preload
         for cable, own in zip(robot.cables, sources, strict=True)
         if own and cable.preload > 0.0),
        default=0.0,
    )  # fmt: skip
    errors = [
        np.interp(np.arange(len(cable.element_names)), sorted(own), [own[k] for k in sorted(own)])
        if own
        else np.full(len(cable.element_names), worst * cable.preload)
        for cable, own in zip(robot.cables, sources, strict=True)
    ]
    return np.concatenate(errors)


def _through(robot: Robot, shape: Shape, tension: Vector, *, together: bool = False) -> Vector:
    """What errors of the tensions are in all columns; cables err independently, or all together."""
    forces = []
    at = 0
    for cable, part in zip(robot.cables, robot.parts, strict=True):
        count = len(cable.pulleys)
        lever = 2.0 * np.abs(np.sin(0.5 * shape.wrap[at : at + count]))
        own = tension[part]
        forces.append(lever * 0.5 * (own[:-1] + own[1:]))
        at += count
    arms = [motor_arms(robot, motor.name) for motor in robot.motors]
    arms += [_joint_arms(shape, j) for j in range(len(robot.joints))]
    own = np.array([[arm[part] @ tension[part] for part in robot.parts] for arm in arms])
    own = own.reshape(len(arms), len(robot.cables))
    efforts = own.sum(axis=1) if together else np.linalg.norm(own, axis=1)
    return np.concatenate([tension, *forces, efforts])
