"""Numbers of all members at once, if only preloads, stiffness and friction are drawn.

A member is a robot file with other numbers.  Reading 32 of them one by one takes 35 ms, which would
interrupt the estimate at every change of a parameter.  Preload, stiffness and friction do not
change the geometry, so the members' numbers differ from the robot's own in a few columns only.  If
other parameters are drawn, or a member violates the rules of a robot file, which are checked here
too, the members are read one by one.  A test requires both ways to agree bit for bit.
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
from cdrj_ros.model.prepared import Model, shape_at
from cdrj_ros.robot.description import LAWS, Cable, Friction, Pulley

Vector = NDArray[np.float64]
Table = NDArray[np.float64]

FIELDS: Final = frozenset(one.name for one in fields(Friction) if one.name != "stribeck")


@dataclass
class _Layer:
    """Friction of a robot, a cable or a pulley by key: one number, or one for every member."""

    given: dict[str, Any] = field(default_factory=dict)


def drawn_numbers(model: Model, drawn: Mapping[str, Vector]) -> Table | None:
    """Numbers of all members, shape (members, numbers).

    Args:
        model: the prepared robot.
        drawn: values of every member, within the schema's ranges, by path [SI].

    Returns:
        The same as reading and preparing every member as a robot file, bit for bit.  None if other
        parameters are drawn, or if the numbers of some member are not allowed.
    """
    members = len(next(iter(drawn.values())))
    numbers = np.repeat(model.numbers[None, :], members, axis=0)
    friction = _Layer(dict(model.robot.document.get("friction", {})))
    entries = model.robot.document["cables"]
    cables = [
        _CableDraw(cable, entry) for cable, entry in zip(model.robot.cables, entries, strict=True)
    ]
    by_name = {one.cable.name: one for one in cables}
    for path, values in drawn.items():
        match path.split("."):
            case ["friction", key] if key in FIELDS:
                friction.given[key] = values
            case ["cables", name, *rest] if name in by_name:
                if not by_name[name].take(rest, values):
                    return None
            case _:
                return None
    lengths = shape_at(model, np.array([joint.reference_angle for joint in model.robot.joints]))
    for c, one in enumerate(cables):
        if not one.write(model, numbers, c, friction, lengths.length):
            return None
    return numbers


class _CableDraw:
    """Drawn parameters of one cable."""

    def __init__(self, cable: Cable, entry: Mapping[str, Any]) -> None:
        self.cable, self._entry = cable, entry
        self._preload: Any = cable.preload
        self._elastic = elasticity_of(cable)
        self._own = _Layer(dict(entry.get("friction", {})))
        self._pulleys = [_Layer(dict(node.get("friction", {}))) for node in entry["nodes"][1:-1]]

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
            case ["friction", key] if key in FIELDS:
                self._own.given[key] = values
            case ["nodes", k, "friction", key] if (
                key in FIELDS and k.isdecimal() and 1 < int(k) < len(self._pulleys) + 2
            ):
                self._pulleys[int(k) - 2].given[key] = values
            case _:
                return False
        return True

    def write(self, model: Model, numbers: Table, c: int, common: _Layer, lengths: Vector) -> bool:
        """Write the cable's numbers; False if those of some member are not allowed."""
        plan = plan_views(model.plan).cables[c]
        views: Any = number_views(model.sizes, numbers)
        for key, value in self._elastic._asdict().items():
            views.cables[key][:, c] = value
        views.cables["preload"][:, c] = self._preload
        views.cables["wound_tension"][:, c] = self._preload
        strain = strain_at(self._elastic, self._preload)
        for k in range(plan.elements):
            place = plan.first_element + k
            views.elements["material"][:, place] = lengths[place] / (1.0 + strain)
        stribeck: Any = plan_views(model.plan).pulleys
        for k, (pulley, own) in enumerate(zip(self.cable.pulleys, self._pulleys, strict=True)):
            place = plan.first_pulley + k
            friction = _friction(pulley, common, self._own, own)
            if friction is None:
                return False
            if not any(isinstance(value, np.ndarray) for value in vars(friction).values()):
                continue
            law = LAWS.index(self.cable.law)
            found = friction_numbers(replace(pulley, friction=friction), law)
            row = views.pulleys[:, place]
            for name, value in found.items():
                row[name] = value
            losses = _losses(row, int(stribeck[place]["stribeck"]))
            row["kinetic_loss"], row["static_loss"] = losses.T
        return True


def _friction(pulley: Pulley, *layers: _Layer) -> Friction | None:
    """Friction of a pulley, with arrays for drawn values; None if a member's is not allowed.

    The rules for merging and checking are those of ``CableReader``.
    """
    merged: dict[str, Any] = {}
    for layer in layers:
        merged.update(layer.given)
    chosen = {key: value for key, value in merged.items() if key in FIELDS}
    kinetic = chosen.get("mu_c", Friction.mu_c)
    chosen.setdefault("mu_s", kinetic)
    friction = replace(pulley.friction, **chosen)
    static = np.asarray(friction.mu_s)
    turns = np.asarray(friction.bearing_friction) * pulley.bearing_diameter < pulley.radius
    parted = np.any(static != kinetic) and "stribeck_speed" not in merged
    if np.any(static < kinetic) or not np.all(turns) or parted:
        return None
    return friction


def _losses(row: Any, stribeck: int) -> Table:
    """Kinetic and static loss of a pulley for every member, shape (members, 2)."""
    names = ("rho", "mu_c", "mu_s", "wrap", "bearing_ratio", "cells")
    columns: Iterable[list[float]] = (row[name].tolist() for name in names)
    return np.array(
        [
            blended_loss(rho, kinetic, static, wrap, bearing, stribeck, cells)
            for rho, kinetic, static, wrap, bearing, cells in zip(*columns, strict=True)
        ]
    )
