"""One update of the prototype compared with OpenSim: two frictionless cables over the same pulleys.

``Scholz2015GeometryPath`` is OpenSim's interface to Simbody's ``CableSpan``.  Geometry, sites and
simplifications are those of ``bench.mjcf``.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Any

import numpy as np

from bench.figures import ROBOT, Row, compared, in_turn
from bench.mjcf import ON_BASE, ROLLING_RADIUS, along, middle, start_of
from bench.update import poses_of, recorded_motion, stepping
from cdrj_ros.model.prepared import load_model
from cdrj_ros.robot.description import Cable, Robot

STEPS = 2_000
ROUNDS = 15
TRAVEL = 2.0 * ROLLING_RADIUS
"""Distance of the two hinges of the rolling joint [m]."""


def _cable(model: Any, cable: Cable, winch: Any, link: Any, side: float) -> tuple[Any, float]:
    """Add one cable; returns its path and its length in the middle pose [m].

    ``side`` is -1 for the mirrored cable.  As in ``bench.mjcf``, a site in the middle of every span
    belongs to the body of the pulley before it.
    """
    import opensim

    spans = [middle(profiles) for profiles in cable.spans]
    begin = start_of(cable.pulleys, spans)
    places = along(begin, cable.pulleys, spans)
    path = opensim.Scholz2015GeometryPath()
    path.setName(cable.name)
    path.appendPathPoint(winch, opensim.Vec3(begin.x, side * begin.y, 0.0))
    for k, (pulley, (centre, outside, end)) in enumerate(zip(cable.pulleys, places, strict=True)):
        body, shift = (link, TRAVEL) if k >= ON_BASE else (model.getGround(), 0.0)
        at = opensim.Vec3(centre[0] - shift, side * centre[1], 0.0)
        sheave = opensim.ContactCylinder(pulley.radius, at, opensim.Vec3(0.0), body)
        sheave.setName(f"{cable.name}_{k}")
        model.addContactGeometry(sheave)
        touched = opensim.Vec3(outside[0] - centre[0], side * (outside[1] - centre[1]), 0.0)
        path.appendObstacle(sheave, touched)
        path.appendPathPoint(body, opensim.Vec3(end.x - shift, side * end.y, 0.0))
    model.addComponent(path)
    wound = sum(middle(pulley.wrap) * pulley.radius for pulley in cable.pulleys)
    return path, sum(spans) - 0.5 * spans[-1] + wound


def lengths(robot: Robot) -> Callable[[float, float], list[float]]:
    """Function of the winch's travel [m] and half the link's angle [rad]: both lengths [m].

    Raises:
        RuntimeError: a length in the middle pose is not the sum of spans and arcs.
    """
    import opensim

    opensim.Logger.removeFileSink()  # it writes opensim.log to the current folder
    model = opensim.Model()
    none = opensim.Vec3(0.0)
    winch, contact, link = (
        opensim.Body(name, 0.1, none, opensim.Inertia(1e-4))
        for name in ("winch", "contact", "link")
    )
    across = opensim.Vec3(0.0, 0.0, 0.5 * pi)  # a slide is along x
    ahead = opensim.Vec3(TRAVEL, 0.0, 0.0)
    ground = model.getGround()
    for body, joint in (
        (winch, opensim.SliderJoint("winch_slide", ground, none, across, winch, none, across)),
        (contact, opensim.PinJoint("first", ground, none, none, contact, none, none)),
        (link, opensim.PinJoint("second", contact, ahead, none, link, none, none)),
    ):
        model.addBody(body)
        model.addJoint(joint)
    cables = [
        _cable(model, cable, winch, link, side)
        for cable, side in zip(robot.cables, (1.0, -1.0), strict=True)
    ]
    state = model.initSystem()
    pose = opensim.Vector(3, 0.0)

    def evaluated(drum: float, angle: float) -> list[float]:
        pose[0], pose[1], pose[2] = drum, angle, angle
        state.setQ(pose)
        model.realizePosition(state)
        return [path.getLength(state) for path, _ in cables]

    for found, (_, length) in zip(evaluated(0.0, 0.0), cables, strict=True):
        if abs(found - length) > 1e-9:
            raise RuntimeError(f"OpenSim's cable is {found} m long instead of {length} m")
    return evaluated


def measure() -> list[Row]:
    """Time per sample [µs]."""
    model = load_model(str(ROBOT))
    motion = recorded_motion(model)
    evaluate = lengths(model.robot)
    poses = [(float(pose[0]), float(pose[1])) for pose in poses_of(motion, STEPS)]

    def evaluated() -> None:
        for drum, angle in poses:
            evaluate(drum, angle)

    theirs, ours = (
        np.array(times) / STEPS * 1e6
        for times in in_turn(ROUNDS, evaluated, stepping(model, motion, STEPS))
    )
    beside = "OpenSim: two CableSpans, no friction"
    return [compared("step", "one update, every output", "µs", ours, beside, theirs)]
