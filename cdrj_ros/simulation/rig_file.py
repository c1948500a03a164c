"""The rig file: sensors, drives, load and faults of the simulated rig, of bags and of the node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from cdrj_ros.foundation.yaml import Document
from cdrj_ros.model.prepared import installed_path
from cdrj_ros.robot.document import check_document, load_schema, read_text, si_document
from cdrj_ros.simulation.faults import CableFault, EncoderFault, fault_of
from cdrj_ros.simulation.load import Load, LoadKind, make_load
from cdrj_ros.simulation.sensors import IDEAL_SENSORS, LOAD_CELLS, SensorSettings

UPDATE_RATE: Final = 500.0
"""Default rate of a controller manager [Hz]."""


@dataclass(frozen=True)
class LoadChoice:
    """The load of the balanced or free joint; None: a default that depends on the use."""

    kind: LoadKind | None = None
    payload: float | None = None
    """[kg]."""
    gravity: float = 9.81
    """Against positive joint angle [m/s^2]."""
    damping: float | None = None
    """[N m s/rad]."""
    stops: tuple[float, float] | None = None
    """Lower and upper end stop [rad] or [m]."""

    def made(self, kind: LoadKind, payload: float, damping: float) -> Load:
        """The load, with these defaults for what was not chosen.

        Raises:
            UsageError: the load is invalid.
        """
        return make_load(
            self.kind or kind,
            payload if self.payload is None else self.payload,
            damping if self.damping is None else self.damping,
            self.gravity,
        )


@dataclass(frozen=True)
class RigDescription:
    """The content of a rig file."""

    sensors: SensorSettings = IDEAL_SENSORS
    load: LoadChoice = field(default_factory=LoadChoice)
    drives: Mapping[str, float] = field(default_factory=dict)
    """``max_acceleration``, and arguments of ``drive_limits``, that are given."""
    faults: tuple[CableFault, ...] = ()
    """Faults of cables; those of encoders are in ``sensors``."""


def load_rig(path: str) -> RigDescription:
    """Read a rig file; a bare name means an installed one, empty: ideal sensors, no fault.

    Raises:
        CdrjError: with one line that names the key, what was given and what is allowed.
    """
    if not path:
        return RigDescription()
    found = str(installed_path(path, "rigs", "rig file"))
    return parse_rig(read_text(found, "rig file"), found)


def parse_rig(text: str, source: str = "rig file") -> RigDescription:
    """The rig that a YAML text describes; ``source`` is named in errors.

    Raises:
        CdrjError: as ``load_rig``.
    """
    document = si_document(text, source, "sensors, drives, load or faults")
    check_document(document, load_schema("cdrj_ros.simulation", "rig.schema.json"), source)
    faults = [fault_of(entry, f"faults[{k}]") for k, entry in enumerate(document.get("faults", ()))]
    load = dict(document.get("load", {}))
    if "stops" in load:
        load["stops"] = tuple(map(float, load["stops"]))
    return RigDescription(
        _sensors(document, tuple(one for one in faults if isinstance(one, EncoderFault))),
        LoadChoice(**load),
        document.get("drives", {}),
        tuple(one for one in faults if isinstance(one, CableFault)),
    )


def _sensors(document: Document, faults: tuple[EncoderFault, ...]) -> SensorSettings:
    cells = document.get("load_cells", {})
    given = {key: value for key, value in cells.items() if key != "elements"}
    efforts, control = document.get("motor_efforts"), document.get("ros2_control")
    return SensorSettings(
        replace(IDEAL_SENSORS.motors, **document.get("motors", {})),
        replace(IDEAL_SENSORS.joints, **document.get("joints", {})),
        None if efforts is None else float(efforts.get("noise", LOAD_CELLS.torque_noise)),
        tuple(cells.get("elements", ())),
        replace(LOAD_CELLS, **given),
        replace(LOAD_CELLS, **document.get("references", {})),
        None if control is None else float(control.get("update_rate", UPDATE_RATE)),
        faults,
    )
