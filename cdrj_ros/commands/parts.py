"""The parts into which the kernels are divided; each is compiled in a process of its own."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Final

from cdrj_ros.model.compiled import kernels_are_compiled

OF_EVERY_START: Final = ("step", "geometry")
"""Parts that every start of the estimator uses; they do not depend on one another."""

IN_SPACE: Final = "space"
"""Part that only robots described in space need."""

INDEPENDENT: Final = (*OF_EVERY_START, IN_SPACE)
"""Parts that are compiled first, at once; the others use them."""

OUTERMOST: Final[Mapping[str, tuple[str, ...]]] = {
    "step": ("model.mechanism.advance",),
    "geometry": (
        "model.cable.solve_cable",
        "model.shape.shape",
        "model.friction.blended_loss",
        "messages.estimate_encoder.write_messages",
    ),
    IN_SPACE: ("model.spatial_shape.shape_in_space",),
    "motor_alone": (
        "estimation.motor_alone_members.run_alone",
        "estimation.motor_alone_members.forget",
    ),
    "recordings": ("model.mechanism.advance_all",),
    "rig": (
        "rig.balance.balance",
        "rig.balance.scan",
        "model.along._along",
        "model.surface.cover_surfaces",
        "rig.forward.swing_steps",
    ),
}
"""The kernels of every part that Python or other kernels call by name; the kernels that these call
are compiled with them."""


def is_compiled(part: str) -> bool:
    """Whether the kernels of a part are on disk, compiled from these sources."""
    for name in OUTERMOST[part]:
        module, _, kernel = name.rpartition(".")
        if not kernels_are_compiled(getattr(import_module(f"cdrj_ros.{module}"), kernel)):
            return False
    return True
