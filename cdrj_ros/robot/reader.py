"""A robot file to a ``Robot``: names, references between parts, and what the schema cannot say.

Everything that a file can get wrong is found here or in ``cdrj_ros.robot.document``, with the path
of the key, what was given and what is allowed.  Inside, robots are trusted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from math import pi
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.robot.description import (
    TABLE_INTERVALS,
    Anchor,
    Cable,
    Frame,
    Friction,
    Joint,
    Motor,
    Node,
    PassiveTorque,
    Place,
    Profile,
    Pulley,
    Robot,
    Sensor,
    Uncertainty,
    Winch,
)
from cdrj_ros.robot.document import Document, parse_document, term_complaints

MAXIMUM_BYTES: Final = 1_000_000
"""A robot file is small; more is not one."""


LONGEST_TEXT: Final = 400
"""Letters of a complaint that quotes the file."""

DEFAULT_BREAKAWAY_ANGLE: Final = 1e-3
"""Angle within which the friction of an axis builds up where the file does not say [rad]."""


def load_robot(path: str | Path) -> Robot:
    """Read a robot file.

    Raises:
        RobotFileError: with one line that names the key, what was given and what is allowed.
    """
    return build_robot(*load_document(path))


def load_document(path: str | Path) -> tuple[Document, str]:
    """What a robot file says, in SI and checked against the schema, and the file's name.

    Raises:
        RobotFileError: see ``load_robot``.
    """
    path = Path(path)
    try:
        # reading a pipe or a device might not end
        if path.exists() and not path.is_file() and not path.is_dir():
            raise RobotFileError(f"cannot read the robot file {path}: it is no regular file")
        size = path.stat().st_size
        if size > MAXIMUM_BYTES:
            raise RobotFileError(
                f"{path} has {size} bytes; a robot file has at most {MAXIMUM_BYTES}"
            )
        data = path.read_bytes()
    except OSError as error:
        raise RobotFileError(f"cannot read the robot file {path}: {error.strerror}") from error
    except ValueError as error:  # a null character
        raise RobotFileError(f"cannot read the robot file {path}: {error}") from error
    try:
        return parse_document(data.decode(), str(path)), str(path)
    except UnicodeDecodeError as error:
        raise RobotFileError(f"{path} is not UTF-8 text") from error


def parse_robot(text: str, source: str = "robot file") -> Robot:
    """The robot that a YAML text describes; ``source`` is named in error messages.

    Raises:
        RobotFileError: see ``load_robot``.
    """
    return build_robot(parse_document(text, source), source)


def build_robot(document: Document, source: str) -> Robot:
    """The robot of a document that keeps to the schema; checks what a schema cannot say.

    Raises:
        RobotFileError: see ``load_robot``.
    """
    return _Builder(document, source).robot()


class _Builder:
    """Turns a valid document into a robot; what needs more than the schema is checked here."""

    def __init__(self, document: Document, source: str) -> None:
        self.document = document
        self.source = source
        self.joints: dict[str, Joint] = {joint.name: joint for joint in self._joints()}

    def error(self, path: str, text: str) -> RobotFileError:
        text = text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]}..."
        return RobotFileError(f"{path} {text} ({self.source})")

    def robot(self) -> Robot:
        document = self.document
        for kind in ("motors", "joints", "frames", "cables"):
            self._unique(kind)
        self.motors = tuple(self._motors())
        for k, motor in enumerate(self.motors):
            if motor.name in self.joints:  # both may be read from one topic
                raise self.error(f"motors[{k}].name", f"{motor.name!r} is the name of a joint")
        self.frames = tuple(self._frames())
        cables = tuple(
            self._cable(f"cables[{k}]", entry) for k, entry in enumerate(document["cables"])
        )
        routed = any(cable.routed for cable in cables)
        return Robot(
            document["name"],
            self.motors,
            tuple(self.joints.values()),
            cables,
            self.frames if routed else (),
            self.source,
            self._uncertainty(),
            document,
        )

    def _uncertainty(self) -> Uncertainty | None:
        entry = self.document.get("uncertainty")
        if entry is None:
            return None
        names, stddev = entry["parameters"], np.array(entry["stddev"], dtype=float)
        if stddev.size != len(names):
            raise self.error(
                "uncertainty.stddev",
                f"must have one entry for each of {len(names)} parameters, got {stddev.size}",
            )
        if len(set(names)) != len(names):
            raise self.error("uncertainty.parameters", "must name every parameter once")
        rows = entry.get("correlation", np.eye(len(names)).tolist())
        if [len(row) for row in rows] != [len(names)] * len(names):
            raise self.error(
                "uncertainty.correlation", f"must have {len(names)} rows of {len(names)} numbers"
            )
        correlation = np.array(rows, dtype=float)
        if (
            not np.allclose(correlation, correlation.T, atol=1e-6)
            or not np.allclose(np.diag(correlation), 1.0, atol=1e-6)
            or np.linalg.eigvalsh(correlation)[0] < -1e-3
        ):
            raise self.error(
                "uncertainty.correlation",
                "must be symmetric, with 1 on the diagonal and no negative eigenvalue",
            )
        return Uncertainty(tuple(names), correlation * np.outer(stddev, stddev))

    def _sensor(self, path: str, entry: Document) -> Sensor:
        scale = float(entry.get("scale", 1.0))
        if scale == 0.0:
            raise self.error(f"{path}.scale", "must not be 0: every reading would be one angle")
        bandwidth = float(entry.get("tracking_bandwidth", 0.0))
        if bandwidth > 0.0 and not (entry.get("resolution", 0.0) or entry.get("noise", 0.0)):
            raise self.error(
                f"{path}.tracking_bandwidth",
                "needs resolution or noise: the angle is kept within them",
            )
        return Sensor(
            scale,
            float(entry.get("offset", 0.0)),
            float(entry.get("period", np.inf)),
            round(entry.get("clock_offset", 0.0) * 1e9),
            float(entry.get("resolution", 0.0)),
            float(entry.get("noise", 0.0)),
            bandwidth,
            *self._correction(f"{path}.correction", entry.get("correction")),
        )

    def _correction(
        self, path: str, entry: Document | None
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        if entry is None:
            return (), ()
        angle, value = tuple(map(float, entry["angle"])), tuple(map(float, entry["value"]))
        if len(angle) != len(value):
            raise self.error(
                f"{path}.value", f"must have {len(angle)} entries like angle, got {len(value)}"
            )
        steps = np.diff(angle)
        if not np.all(steps > 0.0):
            raise self.error(f"{path}.angle", "must increase")
        if not np.all(np.diff(value) > -steps):
            raise self.error(
                f"{path}.value", "falls so steeply that two readings would be one angle"
            )
        return angle, value

    def _passive(self, entry: Document) -> PassiveTorque:
        torque = float(entry.get("bearing_torque", 0.0))
        return PassiveTorque(
            torque,
            float(entry.get("bearing_stiffness", torque / DEFAULT_BREAKAWAY_ANGLE)),
            float(entry.get("spring_stiffness", 0.0)),
            float(entry.get("spring_rest", 0.0)),
        )

    def _unique(self, kind: str) -> None:
        seen: set[str] = set()
        for k, entry in enumerate(self.document.get(kind, [])):
            if entry["name"] in seen:
                raise self.error(f"{kind}[{k}].name", f"{entry['name']!r} is taken already")
            seen.add(entry["name"])

    def _motors(self) -> Iterator[Motor]:
        for k, entry in enumerate(self.document["motors"]):
            yield Motor(
                entry["name"],
                float(entry.get("reference_angle", 0.0)),
                float(entry.get("max_speed", np.inf)),
                entry.get("effort_sign", 1),
                self._passive(entry),
                self._sensor(f"motors[{k}]", entry),
            )

    def _joints(self) -> Iterator[Joint]:
        for k, entry in enumerate(self.document["joints"]):
            lower, upper = map(float, entry["range"])
            if not lower < upper:
                raise self.error(f"joints[{k}].range", f"must increase, got [{lower}, {upper}]")
            reference = float(entry.get("reference_angle", 0.0))
            if not lower <= reference <= upper:
                raise self.error(
                    f"joints[{k}].reference_angle",
                    f"must lie in the range [{lower:g}, {upper:g}], got {reference:g}",
                )
            yield Joint(
                entry["name"],
                lower,
                upper,
                reference,
                float(entry.get("max_speed", np.inf)),
                entry.get("effort_sign", 1),
                self._passive(entry),
                self._sensor(f"joints[{k}]", entry),
            )

    def _frames(self) -> Iterator[Frame]:
        known = {"base"}
        yield Frame("base", None, "fixed", None, 0.0, 0.0, 0.0)
        for k, entry in enumerate(self.document.get("frames", [])):
            path = f"frames[{k}]"
            if entry["name"] == "base":
                raise self.error(f"{path}.name", "'base' is the frame that is always there")
            parent = entry.get("parent", "base")
            if parent not in known:
                raise self.error(
                    f"{path}.parent", f"must name an earlier frame ({_list(known)}), got {parent!r}"
                )
            motion = entry["motion"]
            joint = entry.get("joint")
            if motion == "fixed":
                if joint is not None:
                    raise self.error(f"{path}.joint", "has no meaning for a fixed frame")
            else:
                self._known_joint(f"{path}.joint", joint)
            if (motion == "rolling") != ("radius" in entry):
                raise self.error(f"{path}.radius", "belongs to a rolling frame, and to no other")
            if "direction" in entry and motion != "prismatic":
                raise self.error(f"{path}.direction", "belongs to a prismatic frame")
            direction = np.array(entry.get("direction", (1.0, 0.0)), dtype=float)
            norm = float(np.hypot(*direction))
            if norm == 0.0:
                raise self.error(f"{path}.direction", "must not be zero")
            x, y = entry.get("origin", (0.0, 0.0))
            known.add(entry["name"])
            yield Frame(
                entry["name"],
                parent,
                motion,
                joint,
                float(x),
                float(y),
                float(entry.get("angle", 0.0)),
                (float(direction[0]) / norm, float(direction[1]) / norm),
                float(entry.get("radius", 0.0)),
            )

    def _known_joint(self, path: str, name: str | None) -> Joint:
        if name not in self.joints:
            raise self.error(path, f"must be one of {_list(self.joints)}, got {name!r}")
        return self.joints[name]

    def _friction(self, path: str, *layers: Document) -> Friction:
        merged: Document = {}
        for layer in layers:
            merged.update(layer)
        merged.pop("law", None)
        mu_c = float(merged.get("mu_c", 0.0))
        merged.setdefault("mu_s", mu_c)
        if merged["mu_s"] < mu_c:
            raise self.error(
                f"{path}.mu_s", f"must be at least mu_c = {mu_c:g}, got {merged['mu_s']:g}"
            )
        if merged["mu_s"] != mu_c and "stribeck_speed" not in merged:
            raise self.error(
                f"{path}.stribeck_speed",
                "is missing: where mu_s differs from mu_c the speed [m/s] that parts them must be "
                "given (published values lie between 1e-4 and 5e-2)",
            )
        names = {field.name for field in fields(Friction)}
        return Friction(**{key: value for key, value in merged.items() if key in names})

    def _cable(self, path: str, entry: Document) -> Cable:
        law_layers = [self.document.get("friction", {}), entry.get("friction", {})]
        law = {**law_layers[0], **law_layers[1]}.get("law", "elastoplastic")
        routed = "spans" not in entry
        nodes = tuple(
            self._node(f"{path}.nodes[{k}]", node, routed, law_layers)
            for k, node in enumerate(entry["nodes"])
        )
        self._check_order(path, nodes)
        spans: tuple[tuple[Profile, ...], ...] = ()
        if not routed:
            given, needed = len(entry["spans"]), len(nodes) - 1
            if given != needed:
                raise self.error(
                    f"{path}.spans",
                    f"must have one entry per element: {needed} for {len(nodes)} nodes, "
                    f"got {given}",
                )
            spans = tuple(
                self._profile(f"{path}.spans[{k}]", span, "m")
                for k, span in enumerate(entry["spans"])
            )
        return Cable(
            entry["name"],
            self._axial_stiffness(path, entry),
            float(entry["preload"]),
            nodes,
            spans,
            float(entry.get("max_tension", np.inf)),
            float(entry.get("slack_tension", 0.1)),
            float(entry.get("sensor_noise", 0.1)),
            law,
        )

    def _axial_stiffness(self, path: str, entry: Document) -> float:
        stiffness = entry.get("axial_stiffness")
        modulus, diameter = entry.get("youngs_modulus"), entry.get("diameter")
        if stiffness is not None and modulus is None and diameter is None:
            return float(stiffness)
        if stiffness is None and modulus is not None and diameter is not None:
            return float(modulus * pi * diameter**2 / 4.0)
        raise self.error(
            path, "needs either axial_stiffness [N], or both youngs_modulus [Pa] and diameter [m]"
        )

    def _check_order(self, path: str, nodes: tuple[Node, ...]) -> None:
        last = len(nodes) - 1
        for k, node in enumerate(nodes):
            if k in (0, last) and isinstance(node, Pulley):
                raise self.error(
                    f"{path}.nodes[{k}].type", "must be winch or anchor at an end, got pulley"
                )
            if 0 < k < last and not isinstance(node, Pulley):
                raise self.error(
                    f"{path}.nodes[{k}].type",
                    f"must be pulley between the ends, got {type(node).__name__.lower()}",
                )

    def _node(
        self, path: str, entry: Document, routed: bool, friction_layers: list[Document]
    ) -> Node:
        kind = entry["type"]
        if routed and "position" not in entry:
            raise self.error(
                f"{path}.position",
                "is missing: a cable without spans is described by the positions of its nodes",
            )
        if not routed:
            for key in ("position", "frame", "turn"):
                if key in entry:
                    raise self.error(
                        f"{path}.{key}", "has no meaning for a cable that is described by spans"
                    )
        place = self._place(path, entry) if routed else None
        if kind == "winch":
            motors = [motor.name for motor in self.motors]
            if entry["motor"] not in motors:
                raise self.error(
                    f"{path}.motor", f"must be one of {_list(motors)}, got {entry['motor']!r}"
                )
            return Winch(entry["motor"], float(entry["radius"]), entry["winding"], place)
        if kind == "anchor":
            return Anchor(float(entry.get("radius", 0.0)), place)
        if routed == ("wrap_angle" in entry):
            raise self.error(
                f"{path}.wrap_angle",
                "follows from the positions and must not be given"
                if routed
                else "is missing: a cable described by spans needs the wrap angle of every pulley",
            )
        own = entry.get("friction", {})
        for key in ("law", "stribeck"):
            if key in own:
                raise self.error(
                    f"{path}.friction.{key}", "is the same for a whole cable; give it there"
                )
        radius = float(entry["radius"])
        friction = self._friction(f"{path}.friction", *friction_layers, own)
        bearing = float(entry.get("bearing_diameter", 0.0))
        if friction.bearing_friction * bearing >= radius:
            raise self.error(
                f"{path}.bearing_diameter",
                f"times bearing_friction {friction.bearing_friction:g} must be less than the "
                f"radius {radius:g} m, got {bearing:g}: such a pulley cannot turn",
            )
        wrap = () if routed else self._profile(f"{path}.wrap_angle", entry["wrap_angle"], "rad")
        return Pulley(
            radius, friction, bearing, float(entry.get("bearing_torque", 0.0)), wrap, place
        )

    def _place(self, path: str, entry: Document) -> Place:
        frame = entry.get("frame", "base")
        names = [known.name for known in self.frames]
        if frame not in names:
            raise self.error(f"{path}.frame", f"must be one of {_list(names)}, got {frame!r}")
        round_ = entry.get("radius", 0.0) > 0.0
        if round_ != ("turn" in entry):
            raise self.error(
                f"{path}.turn",
                "is missing: ccw or cw, the sense in which the cable goes round"
                if round_
                else "has no meaning for a point",
            )
        turn = {"ccw": 1, "cw": -1}[entry["turn"]] if round_ else 0
        x, y = entry["position"]
        return Place(frame, float(x), float(y), turn)

    def _profile(self, path: str, entry: Any, unit: str) -> tuple[Profile, ...]:
        """A number, a function of a joint, or a list of such terms."""
        if not isinstance(entry, list):
            if isinstance(entry, dict):
                return (self._function(path, entry),)
            if not entry > 0.0:
                raise self.error(path, f"must be greater than 0 {unit}, got {entry:g}")
            return (_constant(float(entry)),)
        return tuple(
            self._function(f"{path}[{k}]", term)
            if isinstance(term, dict)
            else _constant(float(term))
            for k, term in enumerate(entry)
        )

    def _function(self, path: str, entry: Document) -> Profile:
        if not _is_plain_term(entry):
            for complaint in term_complaints(entry, path):
                raise RobotFileError(f"{complaint} ({self.source})")
        joint = self._known_joint(f"{path}.joint", entry["joint"])
        grid = np.linspace(joint.lower, joint.upper, TABLE_INTERVALS + 1)
        offset = float(entry.get("offset", 0.0))
        slope, sine = float(entry.get("slope", 0.0)), float(entry.get("sine", 0.0))
        values = offset + slope * grid + sine * np.sin(grid)
        slopes = slope + sine * np.cos(grid)
        if ("angle" in entry) != ("value" in entry):
            raise self.error(path, "needs both angle and value for a table")
        if "angle" in entry:
            table = self._table(path, entry, joint)
            values = values + table(grid)
            slopes = slopes + _monotone(table(grid), table.derivative()(grid), grid[1] - grid[0])
        return Profile(joint.name, grid, values, slopes)

    def _table(self, path: str, entry: Document, joint: Joint) -> Any:
        angle = np.array(entry["angle"], dtype=float)
        value = np.array(entry["value"], dtype=float)
        if angle.size != value.size:
            raise self.error(
                f"{path}.value", f"must have {angle.size} entries like angle, got {value.size}"
            )
        if not np.all(np.diff(angle) > 0.0):
            raise self.error(f"{path}.angle", "must increase")
        slack = 1e-9 + 1e-6 * (joint.upper - joint.lower)
        if angle[0] > joint.lower + slack or angle[-1] < joint.upper - slack:
            raise self.error(
                f"{path}.angle",
                f"must cover the range [{joint.lower:g}, {joint.upper:g}] rad of {joint.name}, "
                f"got [{angle[0]:g}, {angle[-1]:g}]",
            )
        from scipy.interpolate import PchipInterpolator  # slow to import, so only where used

        return PchipInterpolator(angle, value, extrapolate=True)


def _monotone(
    values: NDArray[np.float64], slopes: NDArray[np.float64], step: float
) -> NDArray[np.float64]:
    """Slopes limited so that a cubic through ``values`` never overshoots (Fritsch, Carlson 1980).

    The grid's points do not fall on the table's, so a bend may lie within an interval.
    """
    secants = np.diff(values) / step
    left = np.concatenate([secants[:1], secants])
    right = np.concatenate([secants, secants[-1:]])
    most = np.where(left * right > 0.0, 3.0 * np.minimum(np.abs(left), np.abs(right)), 0.0)
    limited: NDArray[np.float64] = np.clip(slopes, -most, most)
    return limited


def _is_plain_term(entry: Document) -> bool:
    """Whether a function is one that the schema needs not be asked about, which takes its time."""
    return isinstance(entry.get("joint"), str) and all(
        key in ("offset", "slope", "sine") and type(value) in (int, float)
        for key, value in entry.items()
        if key != "joint"
    )


def _constant(value: float) -> Profile:
    empty: NDArray[np.float64] = np.empty(0)
    return Profile(None, empty, np.array([value]), empty)


def _list(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "(none)"
