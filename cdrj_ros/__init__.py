"""Tension of every cable element of a cable-driven mechanism, from motor encoders and joint angles.

    import cdrj_ros as cdrj

All public names are listed in ``__all__`` and described in docs/api.md.  They keep their meaning;
modules below this one are the package's own and may change.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as typing.TYPE_CHECKING, which takes longer to import than all of this
if TYPE_CHECKING:
    from typing import Any, Final

    from cdrj_ros.api import Estimator, draw, estimate, identify, load, validate, write_recording
    from cdrj_ros.estimation.estimator import (
        Estimate,
        Estimates,
        Sample,
        State,
        initial_state,
        step,
    )
    from cdrj_ros.estimation.session import Options
    from cdrj_ros.evaluation.metrics import ChannelError, Errors
    from cdrj_ros.foundation.arrays import Series
    from cdrj_ros.foundation.errors import BagError, CdrjError, RobotFileError, UsageError
    from cdrj_ros.identification.fit import Identification
    from cdrj_ros.inspection.ranges import Inspection, inspect_robot
    from cdrj_ros.model.packing import INVALID, OVERLOAD, SLACK, STALE, UNSURE, Layout
    from cdrj_ros.model.prepared import Model, Shape, shape_at
    from cdrj_ros.recordings.recording import Recording, Topics, read_recording
    from cdrj_ros.recordings.table import read_table
    from cdrj_ros.robot.description import Robot
    from cdrj_ros.robot.imported import import_mjcf
    from cdrj_ros.simulation.assembly import Truth
    from cdrj_ros.simulation.drives import follow_joints
    from cdrj_ros.simulation.load import Load, make_load, usual_load
    from cdrj_ros.simulation.truth import simulate

    __version__: str
    """The version in package.xml."""

__all__ = [
    "INVALID",
    "OVERLOAD",
    "SLACK",
    "STALE",
    "UNSURE",
    "BagError",
    "CdrjError",
    "ChannelError",
    "Errors",
    "Estimate",
    "Estimates",
    "Estimator",
    "Identification",
    "Inspection",
    "Layout",
    "Load",
    "Model",
    "Options",
    "Recording",
    "Robot",
    "RobotFileError",
    "Sample",
    "Series",
    "Shape",
    "State",
    "Topics",
    "Truth",
    "UsageError",
    "__version__",
    "draw",
    "estimate",
    "follow_joints",
    "identify",
    "import_mjcf",
    "initial_state",
    "inspect_robot",
    "load",
    "make_load",
    "read_recording",
    "read_table",
    "shape_at",
    "simulate",
    "step",
    "usual_load",
    "validate",
    "write_recording",
]

_HOMES: Final = {
    "api": ("Estimator", "draw", "estimate", "identify", "load", "validate", "write_recording"),
    "estimation.estimator": ("Estimate", "Estimates", "Sample", "State", "initial_state", "step"),
    "estimation.session": ("Options",),
    "evaluation.metrics": ("ChannelError", "Errors"),
    "foundation.arrays": ("Series",),
    "foundation.errors": ("BagError", "CdrjError", "RobotFileError", "UsageError"),
    "identification.fit": ("Identification",),
    "inspection.ranges": ("Inspection", "inspect_robot"),
    "model.prepared": ("Model", "Shape", "shape_at"),
    "model.packing": ("INVALID", "OVERLOAD", "SLACK", "STALE", "UNSURE", "Layout"),
    "recordings.recording": ("Recording", "Topics", "read_recording"),
    "recordings.table": ("read_table",),
    "robot.description": ("Robot",),
    "robot.imported": ("import_mjcf",),
    "simulation.assembly": ("Truth",),
    "simulation.drives": ("follow_joints",),
    "simulation.load": ("Load", "make_load", "usual_load"),
    "simulation.truth": ("simulate",),
}
"""The module of every public name: it is imported when the name is used for the first time, so that
``import cdrj_ros`` is quick and a command can handle Ctrl-C before slow modules are imported."""


if not TYPE_CHECKING:  # to a type checker, a module with __getattr__ has every name

    def __getattr__(name: str) -> Any:
        """Import a public name from its module (PEP 562)."""
        if name == "__version__":
            value: Any = _version()
        else:
            home = next((module for module, names in _HOMES.items() if name in names), None)
            if home is None:
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
            from importlib import import_module

            value = getattr(import_module(f"{__name__}.{home}"), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        """The public names."""
        return __all__


def _version() -> str:
    """Read the version from package.xml, beside the source; an installed copy has metadata."""
    import re
    from pathlib import Path

    manifest = Path(__file__).resolve().parents[1] / "package.xml"
    if manifest.is_file():
        found = re.search(r"<version>(.+?)</version>", manifest.read_text(encoding="utf-8"))
        if found:
            return found[1]
    from importlib import metadata  # slow, and not needed beside the source

    return metadata.version("cdrj_ros")
