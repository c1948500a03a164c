"""Standard deviations that the spread of the ensemble does not contain.

These are the error of the model itself, which ``identify`` finds from residuals, and the tension
that a cable may have although its status is SLACK.
See docs/estimation.md.
"""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np

from cdrj_ros.foundation.arrays import Table, Vector
from cdrj_ros.model.packing import stddev_places
from cdrj_ros.model.prepared import Model, Shape, shape_at
from cdrj_ros.robot.description import (
    LARGEST_STRAIN,
    MOST_PRELOADS,
    Robot,
    Winch,
    turns_of,
)

LEAST_ARM: Final = 0.05
"""Moment arms below this fraction of the largest are not used to turn an effort into a tension."""

LARGEST_LOAD: Final = 0.3
"""Share of a joint's motion by which loads stretch a cable at most."""

FREE: Final = 1.5
"""The same where a cable may take up the whole motion, with a greater arm than in the reference."""


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
    known = in_all_quantities(model, shape, error)
    for name, k in stddev_places(model.layout).items():
        known[k] = given.get(name, known[k])
    return np.stack([known**2, in_all_quantities(model, shape, slack)])


def _arms(robot: Robot, shape: Shape) -> Table:
    """Magnitude of every axis's effort per newton in an element [m], shape (elements, axes)."""
    motors = {motor.name: m for m, motor in enumerate(robot.motors)}
    arms = np.zeros((len(shape.length), len(robot.axes)))
    for cable, part in zip(robot.cables, robot.parts, strict=True):
        for node, element in ((cable.nodes[0], part.start), (cable.nodes[-1], part.stop - 1)):
            if isinstance(node, Winch):
                for name, winding in turns_of(node).items():
                    arms[element, motors[name]] = abs(winding) * node.radius
    levers = np.abs(shape.lever_arm)
    least = LEAST_ARM * np.maximum(levers.max(axis=0, initial=0.0), 1e-300)
    arms[:, len(motors) :] = np.where(levers > least, levers, 0.0)
    return arms


def _by_cable(robot: Robot, of_elements: Table) -> Table:
    """Sums over the elements of every cable, shape (cables, ...)."""
    return np.add.reduceat(of_elements, [part.start for part in robot.parts], axis=0)


def stiffness(robot: Robot, shape: Shape) -> Table:
    """Change of every cable's mean tension per change of an angle [N/rad], or [N/m] if it slides.

    Without friction and at high tension; shape (cables, axes).  A cable of length L that an axis
    lengthens by the arm r takes E A r / L per radian.
    """
    arms = _arms(robot, shape)
    arms[:, len(robot.motors) :] = np.abs(shape.lever_arm)
    stiffness = [cable.axial_stiffness for cable in robot.cables]
    return _by_cable(robot, arms) * (stiffness / _by_cable(robot, shape.length))[:, None]


def offset_gain(model: Model) -> Table:
    """Change of every column of ``stddev_columns`` per offset of an encoder (U12), (columns, axes).

    Those of several cables add up, as they do where cables pull against each other.
    """
    robot = model.robot
    shape = shape_at(model, robot.reference_pose)
    tension = robot.per_element(stiffness(robot, shape))
    efforts = np.einsum("ea,eb->ab", _arms(robot, shape), tension)
    return _in_order(model, tension, _forces(model, shape, tension), efforts)


def largest_tensions(robot: Robot) -> Vector:
    """Largest tension that every cable may have [N], shape (cables,)."""
    return np.array(
        [
            cable.maximum_tension
            if isfinite(cable.maximum_tension)
            else MOST_PRELOADS * cable.preload or LARGEST_STRAIN * cable.axial_stiffness
            for cable in robot.cables
        ]
    )


def load_share(model: Model) -> Table:
    """By what share of an axis's motion a load stretches a cable, (C15), shape (cables, axes).

    A load in proportion to the pose reaches the largest tension of a cable no sooner than its
    joints reach the ends of their ranges, and its share is ``LARGEST_LOAD`` at most.  The share is
    0 for motors and ``FREE`` for joints that no cable hinders to move through their ranges while
    the motors stand still, and for axes of cables that only such joints act on.
    """
    robot, motors = model.robot, len(model.robot.motors)
    share = np.full((len(robot.cables), len(robot.axes)), FREE)
    if robot.unmeasured:
        return share
    ranges = np.array([joint.upper - joint.lower for joint in robot.joints])
    change = stiffness(robot, shape_at(model, robot.reference_pose))[:, motors:] * ranges
    most = largest_tensions(robot)
    held = (change > most[:, None]).any(axis=0)
    whole = change[:, held].sum(axis=1)
    for c in np.flatnonzero(whole > 0.0).tolist():
        share[c, :motors] = 0.0
        share[c, motors:][held] = min(most[c] / whole[c], LARGEST_LOAD)
    return share


def length_share(model: Model) -> Vector:
    """Length of every element by that of its cable, in the reference pose, shape (elements,)."""
    robot = model.robot
    shape = shape_at(model, robot.reference_pose)
    return shape.length / robot.per_element(_by_cable(robot, shape.length))


def _tension_errors(robot: Robot, shape: Shape, given: dict[str, float]) -> Vector:
    """Model error of every tension [N]: (U5), shape (elements,).

    The cables that act on an effort share its error.  Along a cable the error is interpolated
    between the elements with given errors, and constant beyond them.  A cable without any has the
    largest error of another one in proportion to its preload: it was not looked at.
    """
    parts = robot.parts
    sources: list[dict[int, float]] = [{} for _ in parts]
    efforts = {f"effort/{axis.name}": k for k, axis in enumerate(robot.axes)}
    all_arms = _arms(robot, shape)
    for name in efforts.keys() & given.keys():
        arms = all_arms[:, efforts[name]]
        acting = [c for c, part in enumerate(parts) if arms[part].any()]
        for c in acting:
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


def _forces(model: Model, shape: Shape, tension: Table) -> Table:
    """What errors of the tensions are in the forces on all pulleys, shape (pulleys, ...)."""
    before = model.layout.element_before
    lever = np.abs(np.sin(0.5 * shape.wrap)).reshape(-1, *(1,) * (tension.ndim - 1))
    return np.asarray(lever * (tension[before] + tension[before + 1]))


def _in_order(model: Model, tension: Table, magnitude: Table, effort: Table) -> Table:
    """Numbers of all elements, pulleys and axes in the order of ``stddev_columns``."""
    motors = len(model.robot.motors)
    own = {
        "tension": tension, "magnitude": magnitude,
        "motor_effort": effort[:motors], "joint_effort": effort[motors:],
    }  # fmt: skip
    return np.concatenate([own[name] for name in model.layout.stddev])


def in_all_quantities(model: Model, shape: Shape, tension: Vector) -> Vector:
    """What errors of the tensions are in all columns, where cables err independently."""
    own = _by_cable(model.robot, _arms(model.robot, shape) * tension[:, None])
    efforts = np.linalg.norm(own, axis=0)
    return _in_order(model, tension, _forces(model, shape, tension), efforts)
