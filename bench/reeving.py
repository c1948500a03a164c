"""The prototype's mechanism for Exudyn: two frictionless reeving springs over the same pulleys.

Geometry and simplifications are those of ``bench.mjcf``.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin
from typing import Any

from bench.mjcf import ON_BASE, ROLLING_RADIUS, along, middle, start_of
from cdrj_ros.robot.description import Cable, Robot


def _rope(system: Any, cable: Cable, bodies: tuple[int, int], winch: list[int], side: float) -> int:
    """Add one cable; ``side`` is -1 for the mirrored one, whose winch turns the other way."""
    from exudyn import Vector3DList
    from exudyn.itemInterface import MarkerBodyRigid, ReevingSystemSprings

    spans = [middle(profiles) for profiles in cable.spans]
    begin = start_of(cable.pulleys, spans)
    places = along(begin, cable.pulleys, spans)
    end = places[-1][2]
    points = [(begin.x, begin.y), *(place[0] for place in places), (end.x, end.y)]
    markers = []
    for k, (x, y) in enumerate(points):
        moving = k > ON_BASE
        position = [x - 2.0 * ROLLING_RADIUS * moving, side * y, 0.0]
        markers.append(
            system.AddMarker(MarkerBodyRigid(bodyNumber=bodies[moving], localPosition=position))
        )
    turns = [side * (-1.0 if k % 2 == 0 else 1.0) for k in range(len(places))]
    spring = ReevingSystemSprings(
        markerNumbers=[*markers, *winch], hasCoordinateMarkers=True, coordinateFactors=[side, 0.0],
        stiffnessPerLength=cable.axial_stiffness, referenceLength=1.0, regularizationForce=-1.0,
        sheavesAxes=Vector3DList([[0.0, 0.0, turn] for turn in (1.0, *turns, 1.0)]),
        sheavesRadii=[0.0, *(pulley.radius for pulley in cable.pulleys), 0.0],
    )  # fmt: skip
    wound = sum(middle(pulley.wrap) * pulley.radius for pulley in cable.pulleys)
    return _checked(system, system.AddObject(spring), sum(spans) - 0.5 * spans[-1] + wound)


def _checked(system: Any, rope: int, length: float) -> int:
    """Compare the length in the middle pose with the sum of spans and arcs."""
    from exudyn import OutputVariableType

    system.Assemble()
    found = system.GetObjectOutput(rope, OutputVariableType.Distance)
    if abs(found - length) > 1e-9:
        raise RuntimeError(f"Exudyn's cable is {found} m long instead of {length} m")
    return int(rope)


def lengths(robot: Robot) -> Callable[[float, float], tuple[float, float]]:
    """Function of the winch's travel [m] and half the link's angle [rad]: both lengths [m]."""
    import exudyn
    from exudyn.itemInterface import (
        MarkerNodeCoordinate,
        Node1D,
        NodePointGround,
        NodeRigidBody2D,
        ObjectGround,
        ObjectMass1D,
        ObjectRigidBody2D,
    )

    system = exudyn.SystemContainer().AddSystem()
    travel = 2.0 * ROLLING_RADIUS
    node = system.AddNode(NodeRigidBody2D(referenceCoordinates=[travel, 0.0, 0.0]))
    link = system.AddObject(ObjectRigidBody2D(mass=1.0, inertia=1.0, nodeNumber=node))
    slide = system.AddNode(Node1D(referenceCoordinates=[0.0]))
    system.AddObject(ObjectMass1D(mass=1.0, nodeNumber=slide))
    fixed = system.AddNode(NodePointGround())
    winch = [
        system.AddMarker(MarkerNodeCoordinate(nodeNumber=number, coordinate=0))
        for number in (slide, fixed)
    ]
    bodies = system.AddObject(ObjectGround()), link
    upper, lower = (
        _rope(system, cable, bodies, winch, side)
        for cable, side in zip(robot.cables, (1.0, -1.0), strict=True)
    )
    put, get = system.systemData.SetODE2Coordinates, system.GetObjectOutput
    distance = exudyn.OutputVariableType.Distance

    def evaluated(drum: float, angle: float) -> tuple[float, float]:
        put([travel * (cos(angle) - 1.0), travel * sin(angle), 2.0 * angle, drum])
        return get(upper, distance), get(lower, distance)

    return evaluated
