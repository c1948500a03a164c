"""Where the camera of a browser stands: the robot fills the window until the visitor moves it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

FIELD: Final = 0.6
"""Vertical angle of view [rad]."""

MARGIN: Final = 1.15
"""Height of the view over that of the robot [-]."""

USUAL_ASPECT: Final = 1.0
"""Width over height of the picture in a usual window, between the panels [-]."""

MOVED: Final = 1e-3
"""A camera that has moved by more than this share of its distance was moved by the visitor."""


class Aim:
    """Points cameras at a robot around the origin, from the front if it is planar."""

    def __init__(self, size: Vector, flat: bool, on_resize: Callable[[], None]) -> None:
        """Prepare.

        Args:
            size: extent of the robot along x, y, z [m], shape (3,).
            flat: whether it is planar.
            on_resize: called if a browser has put its panels in place or was resized.
        """
        x, y, z = size
        self._across, self._up = (x, y) if flat else (np.hypot(x, y), z + 0.5 * np.hypot(x, y))
        self._upwards = np.array([0.0, 1.0, 0.0] if flat else [0.0, 0.0, 1.0])
        self._side = np.array([0.12, 0.15, 0.98] if flat else [0.64, -0.64, 0.42])
        self._on_resize = on_resize

    def position(self, aspect: float) -> Vector:
        """Where a camera sees the whole robot [m], shape (3,).

        Args:
            aspect: width over height of the picture [-].
        """
        height = MARGIN * max(self._up, self._across / aspect)
        return np.asarray(height / (2.0 * np.tan(0.5 * FIELD)) * self._side)

    def begin(self, camera: Any) -> None:
        """Set the first camera of all browsers of a viser server, also that of its "reset view"."""
        camera.up = self._upwards
        camera.look_at = np.zeros(3)
        camera.fov = FIELD
        camera.position = self.position(USUAL_ASPECT)

    def follow(self, client: Any) -> None:
        """Fit the robot into the picture of a browser, and again whenever its size changes.

        A browser reports its whole window first and the part between the panels later, how much
        later depends on the machine.
        """
        own = [self.position(USUAL_ASPECT)]
        seen: list[tuple[int, int]] = []

        def fit(camera: Any) -> None:
            size = (camera.image_width, camera.image_height)
            if min(size) < 1:
                return
            if not seen:
                own.append(camera.position)
            near = MOVED * np.linalg.norm(camera.position)
            if min(np.linalg.norm(camera.position - one) for one in own) > near:
                return
            if size not in seen[-1:]:
                seen.append(size)
                own.append(self.position(size[0] / size[1]))
                camera.position = own[-1]
                camera.look_at = np.zeros(3)  # viser moves it together with the position
                self._on_resize()
            elif np.linalg.norm(camera.look_at) > near:  # lost between two messages
                camera.look_at = np.zeros(3)

        client.camera.on_update(fit)
        fit(client.camera)
