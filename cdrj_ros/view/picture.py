"""How cables, bodies and forces are drawn: path, colour and width, for RViz and the browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from cdrj_ros.foundation.arrays import Points, Vector
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.model.packing import SLACK, UNSURE
from cdrj_ros.model.prepared import Model
from cdrj_ros.report.scene import (
    LONG_SPAN,
    Body,
    Colour,
    PlacedVisual,
    Scene,
    by_cable,
    inner_size,
    scene_of,
    tension_colour,
)
from cdrj_ros.report.status import SIGMAS
from cdrj_ros.view.history import Snapshot, usable


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
    """Points of all elements and bodies but those of long ends; each of shape (n, 3)."""
    yield from scene.links
    yield from (visual.points for visual in scene.visuals)
    most = LONG_SPAN * inner_size(model, scene)
    for paths, own in by_cable(model.robot, scene):
        first = int(np.linalg.norm(paths[0][-1] - paths[0][0]) > most)
        last = int(np.linalg.norm(paths[-1][-1] - paths[-1][0]) > most)
        yield from paths[first : len(paths) - last]
        for body in own[first : len(own) - last]:
            flat = body.axis if body.shape == "disc" else np.zeros(3)
            corner = body.radius * np.sqrt(1.0 - flat**2)
            yield body.centre + np.array([corner, -corner])


SLIP_SPEED: Final = 1e-4
"""Slip speed from which a pulley is drawn as slipping [m/s]."""

SLIPPING: Final[Colour] = (0.96, 0.55, 0.15)
STICKING: Final[Colour] = (0.72, 0.72, 0.70)
UNKNOWN: Final[Colour] = (0.55, 0.55, 0.55)
FORCE: Final[Colour] = (0.20, 0.20, 0.22)
LINKS: Final[Colour] = (0.80, 0.81, 0.83)

DASHES: Final = 12
"""Number of dashes of an element whose tension must not be used."""

PALE: Final = 0.4
"""Opacity of an element that is UNSURE."""

POINTS_ONLY: Final = 0.05
"""Radius on which the picture of a robot without pulleys is based, as a share of its size."""

LINK: Final = 0.45
"""Radius of a link, as a share of the usual radius of a pulley."""

THIN: Final = 0.4
"""Width of a slack element, as a share of that of a taut one."""


class DrawnCable(NamedTuple):
    """One element."""

    name: str
    path: Points
    """[m], shape (n, 3)."""
    dashed: bool
    """Whether its tension must not be used."""
    width: float
    """[m]."""
    colour: Colour
    opacity: float
    label: str
    """Name, tension and two standard deviations."""


class DrawnBody(NamedTuple):
    """One winch, pulley, round body, eyelet or anchor."""

    body: Body
    """As it is drawn: a point has a radius, and a disc a length along its axis."""
    colour: Colour


class DrawnForce(NamedTuple):
    """Force of a cable on a pulley."""

    body: int
    """Index of the pulley in ``Picture.bodies``."""
    start: Points
    """[m], shape (3,)."""
    end: Points
    """[m], shape (3,); NaN if the force is unknown."""
    width: float
    """[m]."""


@dataclass(frozen=True, eq=False)
class Picture:
    """Everything that is drawn at one time."""

    cables: tuple[DrawnCable, ...]
    """In the order of ``Layout.elements``."""
    bodies: tuple[DrawnBody, ...]
    """In the order of ``Scene.bodies``."""
    links: tuple[Points, ...]
    """Both ends of every link [m], shape (2, 3)."""
    link_width: float
    """Radius of a link [m]."""
    arrows: tuple[DrawnForce, ...]
    """Of the pulleys of cables given by positions."""
    visuals: tuple[PlacedVisual, ...]
    """Shapes of the robot's bodies."""


def picture_of(model: Model, shown: Snapshot, *, force_scale: float = 0.0005) -> Picture:
    """The picture of a snapshot.

    Args:
        model: the prepared robot.
        shown: what to draw.
        force_scale: length of an arrow [m/N].

    Raises:
        CdrjError: the cables have no path at these joint angles.
    """
    scene = scene_of(model, shown.angle)
    return Picture(
        tuple(_cables(model, scene, shown)),
        tuple(_bodies(model, scene, shown)),
        scene.links,
        LINK * typical_radius(model, scene),
        tuple(_arrows(model, scene, shown, force_scale)),
        scene.visuals,
    )


def tension_words(tension: float, stddev: float) -> str:
    """A tension and, if they are known, two standard deviations."""
    return f"{tension:.1f}" + (f" ± {SIGMAS * stddev:.1f} N" if np.isfinite(stddev) else " N")


def typical_radius(model: Model, scene: Scene) -> float:
    """Median radius of winches, pulleys and anchors, or a share of the robot's size [m]."""
    radii = [node.radius for cable in model.robot.cables for node in cable.nodes if node.radius > 0]
    return float(np.median(radii)) if radii else POINTS_ONLY * inner_size(model, scene)


def dashes_of(path: Points) -> Points:
    """Ends of dashes along a path, shape (2 * DASHES, 3)."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], 2 * DASHES)
    return np.column_stack([np.interp(at, along, path[:, k]) for k in range(3)])


def _cables(model: Model, scene: Scene, shown: Snapshot) -> list[DrawnCable]:
    width = 0.1 * typical_radius(model, scene)
    flags, known = shown.status, usable(shown.status)
    looks = []
    cables = [cable for cable in model.robot.cables for _ in cable.element_names]
    for e, (name, cable) in enumerate(zip(model.layout.elements, cables, strict=True)):
        tension = float(shown.tension[e])
        good = bool(known[e]) and np.isfinite(tension)
        looks.append(
            DrawnCable(
                name,
                scene.elements[e],
                not good,
                width * (THIN if flags[e] & SLACK else 1.0),
                tension_colour(tension, cable.preload, cable.maximum_tension) if good else UNKNOWN,
                PALE if flags[e] & UNSURE else 1.0,
                f"{name} {tension_words(tension, float(shown.stddev[e])) if good else '?'}",
            )
        )
    return looks


def _bodies(model: Model, scene: Scene, shown: Snapshot) -> list[DrawnBody]:
    known = usable(shown.pulley_status)
    slipping = known & (np.abs(np.nan_to_num(shown.slip_speed)) > SLIP_SPEED)
    slips = dict(zip(model.layout.pulleys, slipping.tolist(), strict=True))
    least = 0.3 * typical_radius(model, scene)
    return [
        DrawnBody(
            replace(
                body,
                radius=max(body.radius, least),
                length=0.5 * least if body.shape == "disc" else body.length,
            ),
            SLIPPING if slips.get(body.name) else STICKING,
        )
        for body in scene.bodies
    ]


def _arrows(model: Model, scene: Scene, shown: Snapshot, scale: float) -> list[DrawnForce]:
    known = usable(shown.pulley_status)
    forces = np.where(known[:, None], shown.force, np.nan)
    by_name = dict(zip(model.layout.pulleys, forces, strict=True))
    placed = {cable.name for cable in model.robot.cables if cable.placed}
    width = 0.05 * typical_radius(model, scene)
    looks = []
    for k, body in enumerate(scene.bodies):
        if body.name.rpartition("/")[0] in placed and body.kind == "pulley":
            end = body.centre + scale * by_name[body.name]
            looks.append(DrawnForce(k, body.centre, end, width))
    return looks
