"""Numbers of all members at once, if only preloads, stiffness and friction are drawn.

A member is a robot file with other numbers.  Reading 32 of them one by one takes 35 ms, which would
interrupt the estimate at every change of a parameter.  Preload, stiffness and friction do not
change the geometry, so the members' numbers differ from the robot's own in a few columns only.  If
other parameters are drawn, or a member violates the rules of a robot file, which are checked here
too, the members are read one by one.  Where friction alone has changed since then, only the columns
of friction are written anew.  Tests require all ways to agree bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.elasticity import elasticity_of, strain_at
from cdrj_ros.model.filling import friction_numbers
from cdrj_ros.model.friction import blended_loss
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.prepared import Model, segments_of, shape_at
from cdrj_ros.robot.description import LAWS, Cable, Friction, Pulley
from cdrj_ros.robot.tolerances import TURNING

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

FIELDS: Final = frozenset(one.name for one in fields(Friction) if one.name != "stribeck")

UNTOUCHED: Final = ("drag",)
"""Friction number of a pulley that depends on no field of ``Friction``."""


def is_friction(path: str) -> bool:
    """Whether a path names a friction parameter of the robot, of a cable or of a pulley."""
    return "friction" in path.split(".")[:-1]


@dataclass
class _Layer:
    """Friction of a robot, a cable or a pulley by key: one number, or one for every member."""

    given: dict[str, Any] = field(default_factory=dict)


def drawn_numbers(
    model: Model, drawn: Mapping[str, Vector], earlier: Table | None = None
) -> Table | None:
    """Numbers of all members, shape (members, numbers).

    Args:
        model: the prepared robot.
        drawn: values of every member, within the schema's ranges, by path [SI].
        earlier: numbers of the same members with other friction, of which any parameters were
            drawn but ``bearing_diameter``; ``drawn`` has those of friction alone.

    Returns:
        The same as reading and preparing every member as a robot file, bit for bit.  None if other
        parameters are drawn (without ``earlier``), or if the numbers of some member are not
        allowed.
    """
    if earlier is None:
        members = len(next(iter(drawn.values())))
        numbers = np.repeat(model.numbers[None, :], members, axis=0)
    else:
        numbers = earlier.copy()
    friction = _Layer(dict(model.robot.document.get("friction", {})))
    entries = model.robot.document["cables"]
    cables = [
        _CableDraw(cable, entry) for cable, entry in zip(model.robot.cables, entries, strict=True)
    ]
    if not _take(drawn, friction, cables):
        return None
    views: Any = number_views(model.sizes, numbers)
    if earlier is None:
        pose = np.array([joint.reference_angle for joint in model.robot.joints])
        lengths = shape_at(model, pose).segment
        for c, one in enumerate(cables):
            one.write_elasticity(model, views, c, lengths)
    written = [one.write_friction(model, views, c, friction) for c, one in enumerate(cables)]
    return numbers if all(written) else None


def _take(drawn: Mapping[str, Vector], friction: _Layer, cables: Sequence[_CableDraw]) -> bool:
    """Hand every drawn parameter to its cable, or to the robot; False if one is not supported."""
    by_name = {one.cable.name: one for one in cables}
    for path, values in drawn.items():
        match path.split("."):
            case ["friction", key] if key in FIELDS:
                friction.given[key] = values
            case ["cables", name, *rest] if name in by_name:
                if not by_name[name].take(rest, values):
                    return False
            case _:
                return False
    return True


class _CableDraw:
    """Drawn parameters of one cable."""

    def __init__(self, cable: Cable, entry: Mapping[str, Any]) -> None:
        self.cable, self._entry = cable, entry
        self._preload: Any = cable.preload
        self._elastic = elasticity_of(cable)
        self._creep: dict[str, Vector] = {}
        self._own = _Layer(dict(entry.get("friction", {})))
        self._pulleys = [_Layer(dict(node.get("friction", {}))) for node in entry["nodes"][1:-1]]
        self._turns = [node["type"] in TURNING for node in entry["nodes"][1:-1]]

    def take(self, rest: Sequence[str], values: Vector) -> bool:
        """Take a parameter by the rest of its path; False if it is not supported here."""
        match rest:
            case ["preload"]:
                self._preload = values
            case ["axial_stiffness"]:
                diameter = self._entry.get("diameter")
                if diameter is None:
                    self._elastic = self._elastic._replace(axial_stiffness=values)
                else:  # the file gives the modulus
                    area = pi * diameter**2 / 4.0
                    stiffness = values / area * pi * diameter**2 / 4.0
                    self._elastic = self._elastic._replace(axial_stiffness=stiffness)
            case ["bedding_strain" | "bedding_tension" as key]:
                self._elastic = self._elastic._replace(**{key: values})
            case ["creep_share" | "creep_time" | "flow_time" as key]:
                self._creep[key] = values
            case ["friction", key] if key in FIELDS:
                self._own.given[key] = values
            case ["nodes", k, "friction", key] if (
                key in FIELDS and k.isdecimal() and 1 < int(k) < len(self._pulleys) + 2
            ):
                self._pulleys[int(k) - 2].given[key] = values
            case _:
                return False
        return True

    def write_elasticity(self, model: Model, views: Any, c: int, lengths: Vector) -> None:
        """Write the cable's elasticity and preload."""
        for key, value in self._elastic._asdict().items():
            views.cables[key][:, c] = value
        for key, value in self._creep.items():
            views.cables[key][:, c] = value
        views.cables["preload"][:, c] = self._preload
        views.cables["wound_tension"][:, c] = self._preload
        strain = strain_at(self._elastic, self._preload)
        own = segments_of(model, c)
        for segment in range(own.start, own.stop):
            views.segments["material"][:, segment] = lengths[segment] / (1.0 + strain)

    def write_friction(self, model: Model, views: Any, c: int, common: _Layer) -> bool:
        """Write the friction of its pulleys; False if that of some member is not allowed."""
        first = plan_views(model.plan).cables[c].first_pulley
        stribeck: Any = plan_views(model.plan).pulleys
        law = LAWS.index(self.cable.law)
        for k, (pulley, own) in enumerate(zip(self.cable.pulleys, self._pulleys, strict=True)):
            row = views.pulleys[:, first + k]
            radius = row["radius"] if self._turns[k] else None
            friction = _friction(pulley, radius, common, self._own, own)
            if friction is None:
                return False
            speed = np.asarray(friction.stribeck_speed)
            without = replace(pulley, friction=replace(friction, stribeck_speed=0.0))
            found: dict[str, Any] = {**friction_numbers(without, law)}
            found["stribeck_speed"] = np.where(speed, speed, found["stribeck_speed"])
            if radius is not None:
                bearing = friction.bearing_friction * pulley.bearing_diameter
                found["bearing_ratio"] = bearing / radius
            for name, value in found.items():
                if name not in UNTOUCHED:
                    row[name] = value
            losses = _losses(row, int(stribeck[first + k]["stribeck"]))
            row["kinetic_loss"], row["static_loss"] = losses.T
        return True


def _friction(pulley: Pulley, radius: Vector | None, *layers: _Layer) -> Friction | None:
    """Friction of a pulley, with arrays for drawn values; None if a member's is not allowed.

    The rules for merging and checking are those of ``CableReader``.

    Args:
        pulley: as in the robot file.
        radius: of every member [m], shape (members,); None if it does not turn.
        *layers: what robot, cable and pulley give, the last has precedence.
    """
    merged: dict[str, Any] = {}
    for layer in layers:
        merged.update(layer.given)
    chosen = {key: value for key, value in merged.items() if key in FIELDS}
    kinetic = chosen.get("mu_c", Friction.mu_c)
    chosen.setdefault("mu_s", kinetic)
    friction = replace(pulley.friction, **chosen)
    static = np.asarray(friction.mu_s)
    parted = np.any(static != kinetic) and "stribeck_speed" not in merged
    if np.any(static < kinetic) or parted:
        return None
    if radius is None:  # the cable slides
        return replace(friction, rho=1.0, bearing_friction=0.0)
    turns = np.asarray(friction.bearing_friction) * pulley.bearing_diameter < radius
    return friction if np.all(turns) else None


def _losses(row: Any, stribeck: int) -> Table:
    """Kinetic and static loss of a pulley for every member, shape (members, 2)."""
    names = ("rho", "mu_c", "mu_s", "wrap", "bearing_ratio")
    columns: Iterable[list[float]] = (row[name].tolist() for name in names)
    return np.array(
        [
            blended_loss(rho, kinetic, static, wrap, bearing, stribeck)
            for rho, kinetic, static, wrap, bearing in zip(*columns, strict=True)
        ]
    )
