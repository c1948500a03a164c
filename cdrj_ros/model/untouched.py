"""Bodies that a cable never touches, or that it passes as if they were not there, and why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.model.impossible import RIM, Suspicion
from cdrj_ros.model.prepared import Model, placed, poses_in_range
from cdrj_ros.robot.description import Cable, Node

MOST_POSES: Final = 400
"""Largest number of poses in which the bodies are looked at."""

OF_BODIES: Final = ("cylinder", "sphere")
"""Kinds of nodes that a cable may leave."""


def untouched_bodies(model: Model) -> Iterator[Suspicion]:
    """Cylinders and spheres that cables never touch or that are ignored, in the file's order.

    Args:
        model: the robot; poses throughout the joint ranges are looked at, those that are
            impossible left out.
    """
    robot = model.robot
    nodes = [node for cable in robot.cables for node in cable.nodes]
    if not any(_is_body(node) for node in nodes):
        return
    looks = []
    for pose in poses_in_range(robot)[:MOST_POSES]:
        shape, views = placed(model, pose)
        if shape.possible:
            looks.append(views.touches)
    for cable, topology in zip(robot.cables, model.connections.cables, strict=True):
        for k, node in enumerate(cable.nodes):
            if looks and _is_body(node):
                touches = np.array([row[int(topology.first_node) + k] for row in looks])
                yield from _body(cable, k, node, touches)


def _is_body(node: Node) -> bool:
    return node.place is not None and node.place.kind in OF_BODIES


def _body(cable: Cable, k: int, node: Node, touches: Any) -> Iterator[Suspicion]:
    """What is to be said of one body, from its contact in all poses."""
    place = node.place
    assert place is not None
    name, kind = f"{cable.name}/{k + 1}", f"the {'ring' if place.inside else place.kind}"
    seen = slice(0, 3 if place.kind == "sphere" else 2)
    before, after = touches["before"][:, seen], touches["after"][:, seen]
    near = np.stack([np.linalg.norm(point, axis=1) for point in (before, after)])
    ignored = near.min(axis=0) < (1.0 - RIM) * node.radius
    size = f"the radius is {1e3 * node.radius:g} mm"
    if ignored.any():
        pose = int(np.argmax(ignored))
        side = int(np.argmin(near[:, pose]))
        where = (
            f"node {k + 2 * side} lies inside it, {1e3 * near[side, pose]:.3g} mm from its centre"
        )
        if ignored.all():
            yield Suspicion(
                name,
                f"{kind} is ignored in all poses, for {where}, {size}: the cable passes up to "
                f"{1e3 * _chord(before, after, node.radius).max():.3g} mm straight through it",
            )
        else:
            share = f"{100.0 * ignored.mean():.0f} % of the poses"
            yield Suspicion(
                name,
                f"{kind} is ignored in {share}, where {where}, {size}: the length jumps on the way",
            )
    elif not touches["touching"].any():
        gap = 1e3 * np.maximum(_distance(before, after) - node.radius, 0.0)
        how = (
            "the straight cable passes through its inside"
            if place.inside
            else f"the straight cable passes it at a distance of {gap.min():.3g} mm or more"
        )
        yield Suspicion(name, f"{kind} is never touched: {how}", grave=False)


def _nearest(before: Any, after: Any) -> Any:
    """Point of the straight lines that is nearest to the centre, of every pose."""
    way = after - before
    square = np.maximum(np.sum(way * way, axis=1), 1e-300)
    share = np.clip(-np.sum(way * before, axis=1) / square, 0.0, 1.0)
    return before + share[:, None] * way


def _distance(before: Any, after: Any) -> Vector:
    """Least distance of the straight lines from the centre [m]."""
    found: Vector = np.linalg.norm(_nearest(before, after), axis=1)
    return found


def _chord(before: Any, after: Any, radius: float) -> Vector:
    """Length of the straight lines within the circle [m]."""
    way = after - before
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-300)
    along = -np.sum(way * before, axis=1) / length
    square = np.sum(before * before, axis=1) - along**2
    half = np.sqrt(np.maximum(radius**2 - square, 0.0))
    begin, end = np.maximum(along - half, 0.0), np.minimum(along + half, length)
    found: Vector = np.maximum(end - begin, 0.0)
    return found
