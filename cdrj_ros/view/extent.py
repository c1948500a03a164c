"""Where a robot lies, without those ends of its cables that are much longer than the rest."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.prepared import Model
from cdrj_ros.report.scene import LONG_SPAN, Scene, inner_size, scene_of

Vector = NDArray[np.float64]
Points = NDArray[np.float64]


def extent_of(model: Model) -> tuple[Vector, Vector]:
    """Lowest and highest corner of the robot [m], shape (3,), in its reference and end poses."""
    joints = model.robot.joints
    lower, upper = ([getattr(joint, end) for joint in joints] for end in ("lower", "upper"))
    points: list[Points] = []
    for pose in ([joint.reference_angle for joint in joints], lower, upper):
        if np.isfinite(pose).all():
            with suppress(CdrjError):
                points += _points(model, scene_of(model, np.array(pose, float)))
    if not points:
        return np.full(3, -1.0), np.ones(3)
    every = np.concatenate(points)
    return every.min(axis=0), every.max(axis=0)


def _points(model: Model, scene: Scene) -> Iterator[Points]:
    """Points of all elements and wheels but those of long ends; each of shape (n, 3)."""
    elements, wheels = iter(scene.elements), iter(scene.wheels)
    cables = [
        ([next(elements) for _ in cable.nodes[1:]], [next(wheels) for _ in cable.nodes])
        for cable in model.robot.cables
    ]
    most = LONG_SPAN * inner_size(model, scene)
    for paths, own in cables:
        first = int(np.linalg.norm(paths[0][-1] - paths[0][0]) > most)
        last = int(np.linalg.norm(paths[-1][-1] - paths[-1][0]) > most)
        yield from paths[first : len(paths) - last]
        for wheel in own[first : len(own) - last]:
            corner = wheel.radius * np.array([1.0, 1.0, 0.0])
            yield np.array(wheel.centre) + np.array([corner, -corner])
