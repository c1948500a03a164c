"""Cables of a robot file: nodes, friction, spans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import pi
from typing import Any, Final

from cdrj_ros.foundation.errors import Refusal, ordered
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.axes import ProfileReader, given
from cdrj_ros.robot.couplings import motor_shares
from cdrj_ros.robot.description import (
    Anchor,
    Cable,
    Friction,
    MovingEnd,
    Node,
    Profile,
    Pulley,
    Winch,
)
from cdrj_ros.robot.space_reader import ONLY_IN_SPACE, PlaceReader, has_bearing

FRICTION_KEYS: Final = frozenset(field.name for field in fields(Friction))


@dataclass(frozen=True)
class CableReader:
    """Reads the cables of one robot file."""

    friction: Document
    """Friction entry of the whole robot, overridden by cables and pulleys."""
    motors: Sequence[str]
    places: PlaceReader
    profiles: ProfileReader
    refuse: Refusal

    def read(self, path: str, entry: Document) -> Cable:
        """One cable.

        Raises:
            RobotFileError: names the key below ``path``, what was given and what is allowed.
        """
        layers = [self.friction, entry.get("friction", {})]
        routed = "spans" not in entry
        nodes = tuple(
            self._node(f"{path}.nodes[{k}]", node, routed, layers)
            for k, node in enumerate(entry["nodes"])
        )
        self._check_order(path, nodes)
        self._check_scales(path, entry)
        numbers = given(
            entry, "slack_tension", "sensor_noise", "rest_length", "bedding_strain",
            "bedding_tension", "creep_share", "creep_time", "flow_time",
            maximum_tension="max_tension",
        )  # fmt: skip
        return Cable(
            entry["name"],
            self._axial_stiffness(path, entry),
            self._preload(path, entry),
            nodes,
            () if routed else self._spans(f"{path}.spans", entry["spans"], len(nodes) - 1),
            **numbers,
            sensor_verified=entry.get("sensor_verified", Cable.sensor_verified),
            law={**layers[0], **layers[1]}.get("law", Cable.law),
        )

    def _spans(
        self, path: str, entries: Sequence[Any], needed: int
    ) -> tuple[tuple[Profile, ...], ...]:
        if len(entries) != needed:
            raise self.refuse(
                path,
                f"must have one entry per element: {needed} for {needed + 1} nodes, "
                f"got {len(entries)}",
            )
        return tuple(
            self.profiles.read(f"{path}[{k}]", span, "m") for k, span in enumerate(entries)
        )

    def _preload(self, path: str, entry: Document) -> float:
        """The preload; 0 for a passive cable, whose preload follows from its rest length."""
        if ("preload" in entry) == ("rest_length" in entry):
            raise self.refuse(
                f"{path}.preload",
                "and rest_length are both given; give one of them"
                if "preload" in entry
                else "is missing: Tension in the reference pose, the same in every element [N]; "
                "or rest_length [m], of a passive cable",
            )
        if "rest_length" in entry:
            for k in (0, len(entry["nodes"]) - 1):
                node = entry["nodes"][k]
                if node["type"] != "anchor" or node.get("radius", 0.0) > 0.0:
                    raise self.refuse(
                        f"{path}.rest_length",
                        f"is that of a cable between two points: nodes[{k}] must be an anchor "
                        "without radius",
                    )
        return float(entry.get("preload", 0.0))

    def _axial_stiffness(self, path: str, entry: Document) -> float:
        stiffness = entry.get("axial_stiffness")
        modulus, diameter = entry.get("youngs_modulus"), entry.get("diameter")
        if stiffness is not None and modulus is None and diameter is None:
            return float(stiffness)
        if stiffness is None and modulus is not None and diameter is not None:
            return float(modulus * pi * diameter**2 / 4.0)
        raise self.refuse(
            path, "needs either axial_stiffness [N], or both youngs_modulus [Pa] and diameter [m]"
        )

    def _check_scales(self, path: str, entry: Document) -> None:
        """Check that what a cable yields comes with the tension or the time in which it does."""
        for share, needed, words in (
            ("bedding_strain", "bedding_tension", "tension [N] at which half of it is taken up"),
            ("creep_share", "creep_time", "time constant [s]"),
        ):
            if entry.get(share, 0.0) > 0.0 and needed not in entry:
                raise self.refuse(
                    f"{path}.{needed}",
                    f"is missing: where {share} is not 0, the {words} must be given",
                )

    def _check_order(self, path: str, nodes: tuple[Node, ...]) -> None:
        last = len(nodes) - 1
        for k, node in enumerate(nodes):
            if k in (0, last) and isinstance(node, Pulley):
                raise self.refuse(
                    f"{path}.nodes[{k}].type", "must be winch or anchor at an end, got pulley"
                )
            if 0 < k < last and not isinstance(node, Pulley):
                raise self.refuse(
                    f"{path}.nodes[{k}].type",
                    f"must be pulley between the ends, got {type(node).__name__.lower()}",
                )

    def _node(
        self, path: str, entry: Document, routed: bool, friction_layers: list[Document]
    ) -> Node:
        self._check_place(path, entry, routed)
        place = self.places.read(path, entry) if routed else None
        if entry["type"] == "winch":
            turned = motor_shares(entry)
            for motor, share in turned.items():
                if motor not in self.motors:
                    raise self.refuse(
                        f"{path}.motor", f"must be one of {ordered(self.motors)}, got {motor!r}"
                    )
                if share == 0.0:
                    raise self.refuse(f"{path}.motor.{motor}", "must not be 0: leave the motor out")
            pitch = float(entry.get("pitch", 0.0))
            if pitch and (place is None or self.places.planar):
                raise self.refuse(f"{path}.pitch", "needs a drum in space, with its axis")
            radius, winding = float(entry["radius"]), entry["winding"]
            return Winch(tuple(turned.items()), radius, winding, place, pitch)
        if entry["type"] == "anchor":
            return Anchor(**given(entry, "radius"), place=place)
        if entry["type"] == "pulley":
            self._check_wrap(path, entry, routed)
        pulley = self._pulley(path, entry, friction_layers)
        wrap: tuple[Profile, ...] = ()
        if "wrap_angle" in entry:
            wrap = self.profiles.read(f"{path}.wrap_angle", entry["wrap_angle"], "rad")
        elif "bend" in entry:
            wrap = self.profiles.read(f"{path}.bend", entry["bend"], "rad")
        moving_end = self._moving_end(path, entry, wrap)
        return replace(
            pulley,
            wrap=wrap,
            place=place,
            cells=1 if entry["type"] == "eyelet" else int(entry.get("cells", Pulley.cells)),
            moving_end=moving_end,
        )

    def _check_place(self, path: str, entry: Document, routed: bool) -> None:
        """Check that the nodes of a routed cable have positions and those of others do not."""
        if routed and "position" not in entry:
            raise self.refuse(
                f"{path}.position",
                "is missing: a cable without spans is described by the positions of its nodes",
            )
        if not routed:
            if entry["type"] in ONLY_IN_SPACE:
                raise self.refuse(
                    f"{path}.type",
                    f"must not be {entry['type']} in a cable that is described by spans",
                )
            for key in ("position", "frame", "turn", "axis"):
                if key in entry:
                    raise self.refuse(
                        f"{path}.{key}", "has no meaning for a cable that is described by spans"
                    )

    def _check_wrap(self, path: str, entry: Document, routed: bool) -> None:
        if routed == ("wrap_angle" in entry):
            raise self.refuse(
                f"{path}.wrap_angle",
                "follows from the positions and must not be given"
                if routed
                else "is missing: a cable described by spans needs the wrap angle of every pulley",
            )

    def _moving_end(self, path: str, entry: Document, wrap: tuple[Profile, ...]) -> MovingEnd:
        """The end of the arc that moves; to be given only where a joint changes a given wrap."""
        if "moving_end" not in entry:
            return Pulley.moving_end
        moving_end: MovingEnd = entry["moving_end"]
        if "wrap_angle" not in entry:
            raise self.refuse(
                f"{path}.moving_end",
                f"follows from the positions and must not be given, got {moving_end!r}",
            )
        if all(profile.joint is None for profile in wrap):
            raise self.refuse(
                f"{path}.moving_end",
                "is allowed only where wrap_angle is a function of a joint: neither end of a "
                f"constant wrap moves, got {moving_end!r}",
            )
        return moving_end

    def _pulley(self, path: str, entry: Document, friction_layers: list[Document]) -> Pulley:
        """Radius and friction of a pulley, or of whatever else guides the cable."""
        own = entry.get("friction", {})
        for key in ("law", "stribeck"):
            if key in own:
                raise self.refuse(
                    f"{path}.friction.{key}", "is the same for a whole cable; give it there"
                )
        radius = float(entry.get("radius", 0.0))
        friction = self._friction(f"{path}.friction", *friction_layers, own)
        if not has_bearing(entry["type"]):
            return Pulley(radius, replace(friction, rho=1.0, bearing_friction=0.0))
        bearing = float(entry.get("bearing_diameter", Pulley.bearing_diameter))
        if friction.bearing_friction * bearing >= radius:
            raise self.refuse(
                f"{path}.bearing_diameter",
                f"times bearing_friction {friction.bearing_friction:g} must be less than the "
                f"radius {radius:g} m, got {bearing:g}: such a pulley cannot turn",
            )
        torque = float(entry.get("bearing_torque", Pulley.bearing_torque))
        return Pulley(radius, friction, bearing, torque)

    def _friction(self, path: str, *layers: Document) -> Friction:
        merged: Document = {}
        for layer in layers:
            merged.update(layer)
        merged.pop("law", None)
        mu_c = float(merged.get("mu_c", Friction.mu_c))
        merged.setdefault("mu_s", mu_c)
        if merged["mu_s"] < mu_c:
            raise self.refuse(
                f"{path}.mu_s", f"must be at least mu_c = {mu_c:g}, got {merged['mu_s']:g}"
            )
        if merged["mu_s"] != mu_c and "stribeck_speed" not in merged:
            raise self.refuse(
                f"{path}.stribeck_speed",
                "is missing: where mu_s differs from mu_c, the speed [m/s] that separates them "
                "must be given (published values lie between 1e-4 and 5e-2)",
            )
        return Friction(**{key: value for key, value in merged.items() if key in FRICTION_KEYS})
