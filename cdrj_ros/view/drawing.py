"""A picture as meshes in a viser scene, updated in place."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.arrays import Faces, Points, Vector
from cdrj_ros.model.prepared import Model
from cdrj_ros.report.scene import Colour, PlacedVisual, Wxyz, mesh_in, middle_of, quaternion_to
from cdrj_ros.view.picture import LINKS, DrawnBody, DrawnCable, Picture, extent_of

SIDES: Final = 8
"""Number of flat sides of a tube."""

POINTS: Final = 33
"""Number of points of a tube's centre line, so that its faces never change."""


def tube(path: Points, radius: float) -> Points:
    """Vertices of a tube with ``FACES``.

    Args:
        path: centre line [m], shape (n, 3).
        radius: [m].

    Returns:
        Rings around ``POINTS`` points of the line [m], shape (POINTS * SIDES, 3).
    """
    at = np.linspace(0.0, len(path) - 1.0, POINTS)  # dense where the path is, on the arcs
    line = np.column_stack([np.interp(at, np.arange(len(path)), path[:, k]) for k in range(3)])
    along = np.gradient(line, axis=0)
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
    # the axis that is farthest from parallel to any piece is across all of them
    axis = np.eye(3)[np.argmin(np.abs(along).max(axis=0))]
    across = np.cross(along, axis)
    size = np.linalg.norm(across, axis=-1, keepdims=True)
    across = np.divide(across, size, out=np.zeros_like(across), where=size > 1e-9)
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)[:, None]
    rings = np.cos(angle) * across[:, None] + np.sin(angle) * np.cross(along, across)[:, None]
    return np.asarray((line[:, None] + radius * rings).reshape(-1, 3), np.float32)


def _faces() -> Faces:
    """Two triangles per side between neighbouring rings."""
    ring, side = np.meshgrid(np.arange(POINTS - 1), np.arange(SIDES), indexing="ij")
    a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
    pairs = np.stack([a, a + SIDES, b, b, a + SIDES, b + SIDES], axis=-1)
    return pairs.reshape(-1, 3).astype(np.uint32)


FACES: Final = _faces()
"""Faces of every tube, shape (f, 3)."""

OnClick = Callable[[str], None]
"""Called with what has been clicked, as ``history.indices_of`` takes it."""

Labels = Literal["none", "chosen", "all"]


Bytes = tuple[int, int, int]

CHOSEN: Final = 1.8
"""Width of the element that is plotted, relative to the others."""

SIZE: Final = 2.0
"""Extent of a drawn robot in the units of the scene, whatever its size in metres."""

ARROWS: Final[Colour] = (0.45, 0.45, 0.50)
"""Colour of forces, visible on white and on black."""


UNLIT: Final = {"cast_shadow": False, "receive_shadow": False}
"""How all nodes are lit."""

LEAST: Final = 0.006
"""Least radius of a taut cable in the units of the scene."""

CLEAR: Final = 0.5
"""Opacity of a body, so that cables behind it are visible."""

BEHIND: Final = 0.25
"""Opacity of the shapes of bodies."""

LAYER: Final = 2.5
"""Distance between the layers of two cables in the plane, in widths of a cable."""


def rgb(colour: Colour) -> Bytes:
    """A colour with components from 0 to 255."""
    red, green, blue = (round(255.0 * part) for part in colour)
    return red, green, blue


def _moved(
    nodes: dict[Any, Any], key: Any, add: Callable[[], Any], position: Vector, wxyz: Wxyz
) -> Any:
    """The node of a scene with this key, added if there is none, at a place."""
    handle = nodes.get(key) or add()
    if handle is not None:
        nodes[key] = handle
        if not (np.array_equal(handle.position, position) and np.array_equal(handle.wxyz, wxyz)):
            handle.position, handle.wxyz = position, np.array(wxyz)
    return handle


def layers_of(model: Model) -> dict[str, int]:
    """Layer of every cable: those in the plane are drawn one in front of the other."""
    robot = model.robot
    flat = [cable.name for cable in robot.cables if robot.planar or not cable.placed]
    layers = dict.fromkeys((cable.name for cable in robot.cables), 0)
    return layers | {name: k for k, name in enumerate(flat)}


class Drawing:
    """The nodes of one robot in a scene."""

    def __init__(self, scene: Any, model: Model, on_click: OnClick) -> None:
        """Prepare the lights.

        Args:
            scene: of a viser server.
            model: the prepared robot.
            on_click: called with what has been clicked, in a thread of the server.
        """
        self._scene, self._model, self._on_click = scene, model, on_click
        self.cables: dict[str, Any] = {}
        """Mesh of every element, by name."""
        self.bodies: dict[str, Any] = {}
        """Mesh or ball of every winch, pulley, round body, eyelet and anchor, by name."""
        self._links: dict[int, Any] = {}
        self.visuals: dict[int, Any] = {}
        """Mesh of every shape of a body that is known, by its index."""
        self._labels: dict[str, Any] = {}
        self._arrows: Any = None
        self._width = 0.0
        """Of a taut cable as it is drawn [m]."""
        self._wider = 1.0
        low, high = extent_of(model)
        self._middle = 0.5 * (low + high)
        self._scale = SIZE / float(np.linalg.norm(high - low))
        self.size = self._scale * (high - low)
        """Extent of the drawn robot in the units of the scene, shape (3,)."""
        self._layers = layers_of(model)
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/lights/all", intensity=2.4)
        scene.add_light_directional("/lights/front", intensity=1.1, position=(0.4, 0.6, 1.0))

    def update(self, picture: Picture, chosen: str, labels: Labels, forces: bool) -> None:
        """Show a picture; what has not changed is not sent.

        Args:
            picture: what to draw.
            chosen: the element or pulley that is plotted, as ``history.indices_of`` takes it.
            labels: which elements have labels.
            forces: whether to draw the forces on pulleys.
        """
        widest = max(look.width for look in picture.cables)
        self._wider = max(1.0, LEAST / (self._scale * widest))
        self._width = self._wider * widest
        for cable in picture.cables:
            plotted = chosen == f"element {cable.name}"
            self._draw_cable(cable, plotted)
            self._draw_label(cable, labels == "all" or (labels == "chosen" and plotted))
        for look in picture.bodies:
            self._draw_body(look, f"pulley {look.body.name}" == chosen)
        self._draw_links(picture)
        self._draw_visuals(picture)
        self._draw_arrows(picture, forces)

    def _placed(self, name: str, points: Vector) -> Vector:
        """Points [m] of a cable in the coordinates of the scene, whose origin is the middle.

        Args:
            name: of an element or body of the cable; of a link empty, which lies behind.
            points: [m], shape (..., 3).
        """
        layer = self._layers[name.rpartition("/")[0]] if name else -1
        ahead = np.array([0.0, 0.0, LAYER * self._width * layer])
        return np.asarray(self._scale * (points - self._middle + ahead))

    def _draw_cable(self, look: DrawnCable, chosen: bool) -> None:
        """A tube, as a net where the tension must not be used."""
        radius = self._scale * self._wider * look.width * (CHOSEN if chosen else 1.0)
        vertices = tube(self._placed(look.name, look.path), radius)
        handle = self.cables.get(look.name)
        if handle is None:
            handle = self.cables[look.name] = self._scene.add_mesh_simple(
                f"/cables/{look.name}", vertices, FACES, side="double", **UNLIT
            )
            handle.on_click(lambda _: self._on_click(f"element {look.name}"))
        handle.vertices, handle.wireframe = vertices, look.dashed
        handle.color, handle.opacity = rgb(look.colour), look.opacity

    def _draw_label(self, look: DrawnCable, wanted: bool) -> None:
        handle = self._labels.get(look.name)
        if not wanted:
            if handle is not None:
                handle.visible = False
            return
        middle = self._placed(look.name, middle_of(look.path))
        if handle is None:
            self._labels[look.name] = self._scene.add_label(
                f"/labels/{look.name}", look.label, position=middle,
                anchor="bottom-center", font_screen_scale=0.8,
            )  # fmt: skip
            return
        handle.visible = True
        handle.text = look.label
        if not np.array_equal(handle.position, middle):
            handle.position = middle

    def _draw_body(self, look: DrawnBody, chosen: bool) -> None:
        """A cylinder of a disc or cylinder, a ball of a sphere or point."""
        body, colour = look.body, rgb(look.colour)
        radius, length = self._scale * body.radius, self._scale * body.length
        name, ball = f"/bodies/{body.name}", body.shape in ("sphere", "point")

        def add() -> Any:
            if ball:
                handle = self._scene.add_icosphere(name, radius, colour, **UNLIT)
            else:
                handle = self._scene.add_cylinder(name, radius, length, colour, **UNLIT)
            if body.kind == "pulley":
                handle.on_click(lambda _: self._on_click(f"pulley {body.name}"))
            return handle

        at = self._placed(body.name, body.centre)
        handle = _moved(self.bodies, body.name, add, at, quaternion_to(body.axis))
        if not ball and handle.height != length:
            handle.height = length
        handle.color, handle.opacity = colour, 1.0 if chosen else CLEAR

    def _draw_links(self, picture: Picture) -> None:
        """Links of the robot, behind cables in the plane."""
        radius = self._scale * picture.link_width
        for k, ends in enumerate(picture.links):
            start, end = self._placed("", ends)
            way = end - start
            length = max(float(np.linalg.norm(way)), 1e-12)
            add = partial(
                self._scene.add_cylinder, f"/links/{k}", radius, length, rgb(LINKS), opacity=CLEAR,
                **UNLIT,
            )  # fmt: skip
            middle = 0.5 * (start + end)
            handle = _moved(self._links, k, add, middle, quaternion_to(way / length))
            if handle.height != length:
                handle.height = length

    def _draw_visuals(self, picture: Picture) -> None:
        """Shapes of bodies, pale behind the cables; a mesh that cannot be read is left out."""
        for k, look in enumerate(picture.visuals):
            at = self._placed("", look.centre)
            _moved(self.visuals, k, partial(self._visual, k, look), at, look.quaternion)

    def _visual(self, k: int, look: PlacedVisual) -> Any:
        """Add a shape; None if it is a mesh that cannot be read."""
        name, size = f"/visuals/{k}", self._scale * look.size
        how = {"color": rgb(LINKS), "opacity": BEHIND, "side": "double", **UNLIT}
        if look.shape == "box":
            return self._scene.add_box(name, dimensions=size, **how)
        if look.shape == "cylinder":
            return self._scene.add_cylinder(name, size[0], size[2], **how)
        if look.shape == "sphere":
            return self._scene.add_icosphere(name, size[0], **how)
        mesh = mesh_in(look.mesh)
        if mesh is None:
            return None
        return self._scene.add_mesh_simple(name, mesh.vertices * size, mesh.faces, **how)

    def _draw_arrows(self, picture: Picture, wanted: bool) -> None:
        known = [a for a in picture.arrows if wanted and not np.isnan(a.end).any()]
        if self._arrows is not None:
            self._arrows.visible = bool(known)
        if not known:
            return
        ends: NDArray[np.float32] = np.array(
            [
                [self._placed(picture.bodies[a.body].body.name, end) for end in a[1:3]]
                for a in known
            ],
            np.float32,
        )
        width = self._scale * known[0].width
        if self._arrows is None or self._arrows.points.shape != ends.shape:
            self._arrows = self._scene.add_arrows(
                "/forces", ends, rgb(ARROWS), shaft_radius=width, head_radius=2.5 * width,
                head_length=4.0 * width,
            )  # fmt: skip
        else:
            self._arrows.points = ends
