"""Access to numbers of a robot file by path: ``cables.upper.friction.rho``.

A path refers to the parsed document: SI units, no unit suffixes, names instead of indices.
Entries without a name are numbered from 1, like elements and pulleys in messages:
``cables.b.nodes.3.bearing_torque`` is pulley ``b/3``, ``cables.b.spans.3.slope`` element ``b/3``.
Names of motors and joints may contain points, and stand as they are.

``joints.dip.coupled.pip`` is the share of the joint ``pip`` in the angle of ``dip``.

A path may name a number that the file leaves out.  Such a number has its default, and setting it
adds an entry at that path.  ``cables.upper.friction.mu_c`` is the value that applies to the pulleys
of the cable, whether it is given for the cable or for the whole robot; a pulley may override it.

If the axial stiffness of a cable is given by modulus and diameter, it can be accessed too; setting
it scales the modulus.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from itertools import chain
from math import isnan, nan, pi
from typing import Any, Final

from cdrj_ros.foundation.errors import UsageError, nearest
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.axes import DEFAULT_BREAKAWAY_ANGLE
from cdrj_ros.robot.couplings import is_coupled
from cdrj_ros.robot.description import Anchor, Friction, PassiveTorque, Pulley, Sensor
from cdrj_ros.robot.document import schema, whole

Keys = tuple[str | int, ...]

NOT_PARAMETERS: Final = ("uncertainty", "residual", "identified", "parts", "assumed")
"""Keys of the file that hold results instead of parameters."""


def _defaults_of(kind: type) -> dict[str, float]:
    return {
        field.name: float(field.default)
        for field in fields(kind)
        if field.default is not MISSING and isinstance(field.default, (int, float))
    }


_AXIS: Final = {
    "reference_angle": 0.0,
    "clock_offset": 0.0,
    "effort_scale": 1.0,
    **_defaults_of(PassiveTorque),
    **_defaults_of(Sensor),
}

DEFAULTS: Final[Mapping[str, Mapping[str, float]]] = {
    "motor": _AXIS,
    "joint": _AXIS,
    "coupled_joint": {"offset": 0.0},
    "friction": _defaults_of(Friction),
    "pulley": _defaults_of(Pulley),
    "swivel": _defaults_of(Pulley),
    "anchor": _defaults_of(Anchor),
    "cable": {"bedding_strain": 0.0},
    "frame": {"angle": 0.0, "multiplier": 1.0, "offset": 0.0},
    "term": {"offset": 0.0, "slope": 0.0, "sine": 0.0},
}
"""Defaults by kind of entry; numbers without a default must be given."""


@dataclass(frozen=True)
class Number:
    """A number of a document, given or left out."""

    path: str
    keys: Keys
    """Keys and indices that lead to it in the document."""
    value: float
    """Value in SI."""
    given: bool
    """Whether the document contains it; otherwise ``value`` is the default."""
    factor: float
    """Ratio of ``value`` to the document's number; differs from 1 for a stiffness given by its
    modulus."""
    rules: Mapping[str, Any]
    """Its part of the schema."""

    @property
    def key(self) -> str:
        """Last name in its path: ``preload``, or ``spans`` for an entry of that list."""
        named = [key for key in self.keys if isinstance(key, str)]
        return self.path.rsplit(".", 1)[-1] if self.factor != 1.0 else named[-1]


@dataclass(frozen=True)
class _Spot:
    """A place in the document, reached by the first segments of a path."""

    keys: Keys
    value: Any
    """Content of the document at this place; None if it is absent."""
    rules: Mapping[str, Any]
    kind: str
    """Name of the definition in the schema, or empty."""


def find_number(document: Document, path: str) -> Number:
    """The number at a path.

    Raises:
        UsageError: the path does not exist, is not a number, or is left out and has no default;
            the message names the alternatives.
    """
    number = _find(document, path)
    if isnan(number.value):
        raise UsageError(f"{path} is not in the file and has no default; it must be given a value")
    return number


def joint_range(document: Document, path: str) -> tuple[float, float] | None:
    """Ends of a joint's range at the path of its reference angle; None at any other path."""
    joint, _, key = path.rpartition(".")
    if key != "reference_angle" or not joint.startswith("joints."):
        return None
    lower, upper = (find_number(document, f"{joint}.range.{end}").value for end in (1, 2))
    return lower, upper


def _find(document: Document, path: str) -> Number:
    """The number at a path; its value is NaN if it is left out and has no default."""
    spot = parent = _Spot((), document, schema(), "")
    segments = path.split(".")
    while segments:
        segment, segments = _first(spot, segments)
        spot, parent = _step(document, spot, segment, path), spot
    return _number(document, path, parent, spot)


def _first(spot: _Spot, segments: list[str]) -> tuple[str, list[str]]:
    """The next segment and the rest; a name with points is one segment, the longest that exists."""
    if isinstance(spot.value, list) or spot.kind == "shares":
        names = _names(spot)
        for count in range(len(segments), 1, -1):
            if (name := ".".join(segments[:count])) in names:
                return name, segments[count:]
    return segments[0], segments[1:]


def number_at(document: Document, path: str) -> float:
    """The value of the number at a path [SI].

    Raises:
        UsageError: as ``find_number``.
    """
    return find_number(document, path).value


def with_numbers(document: Document, values: Mapping[str, float]) -> Document:
    """Copy of the document with new numbers, given by path [SI].

    A number that the document leaves out is added at its path.  The result is not validated;
    ``build_robot`` does that.

    Raises:
        UsageError: as ``find_number``, except that numbers without a default may be set.
    """
    numbers = [_find(document, path) for path in values]
    return writer_of(document, numbers)(tuple(values.values()))


def writer_of(
    document: Document, numbers: Sequence[Number]
) -> Callable[[Sequence[float]], Document]:
    """``with_numbers`` for many sets of values of numbers that were found once."""

    def written(values: Sequence[float]) -> Document:
        changed = dict(document)
        copies: dict[Keys, Any] = {(): changed}
        for number, value in zip(numbers, values, strict=True):
            if not number.given or value != number.value:
                _own_copy(copies, number.keys[:-1])[number.keys[-1]] = value / number.factor
        return changed

    return written


def _own_copy(copies: dict[Keys, Any], keys: Keys) -> Any:
    """The part of a copied document at a place, copied once itself; the rest stays shared."""
    if keys not in copies:
        outer, key = _own_copy(copies, keys[:-1]), keys[-1]
        inner = outer.get(key, {}) if isinstance(outer, dict) else outer[key]
        copies[keys] = outer[key] = inner.copy()
    return copies[keys]


def matching_paths(document: Document, pattern: str) -> tuple[tuple[str, ...], ...]:
    """Groups of paths that a pattern matches.

    ``*`` or ``[a,b]`` in place of a name matches several paths as one group.  With braces, ``{*}``
    or ``{a,b}``, each path forms a separate group.

    Raises:
        UsageError: as ``find_number``, or nothing matches.
    """
    groups: dict[tuple[str, ...], list[str]] = {}
    root = _Spot((), document, schema(), "")
    for apart, segments in _expanded(document, root, split_outside(pattern, "."), pattern):
        groups.setdefault(apart, []).append(".".join(segments))
    for path in chain.from_iterable(groups.values()):
        _find(document, path)
    return tuple(tuple(group) for group in groups.values())


def split_outside(text: str, separator: str) -> list[str]:
    """Split at separators outside of brackets and braces."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "[{") - (letter in "]}")
        if letter == separator and depth <= 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _expanded(
    document: Document, spot: _Spot, segments: list[str], pattern: str
) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """All paths below a place that match a pattern, as (names in braces, path)."""
    if not segments:
        return [((), ())]
    segment, rest = _first(spot, segments)
    apart = segment.startswith("{") and segment.endswith("}")
    several = segment.startswith("[") and segment.endswith("]")
    inner = segment[1:-1] if apart or several else segment
    every = inner == "*"
    if every:
        names = [name for name in _names(spot) if name not in NOT_PARAMETERS]
    else:
        names = [name.strip() for name in inner.split(",")]
    found = []
    complaint: UsageError | None = None
    for name in names:
        try:
            below = _expanded(document, _step(document, spot, name, pattern), rest, pattern)
            if every:  # * matches only entries that have the number: a winch has no bearing torque
                for _, path in below:
                    _find(document, ".".join([*_named(document, spot), name, *path]))
        except UsageError as error:
            if not every:
                raise
            complaint = error
            continue
        found += [((name, *key) if apart else key, (name, *path)) for key, path in below]
    if not found:
        raise complaint or UsageError(f"{pattern} matches nothing in this robot file")
    return found


def _named(document: Document, spot: _Spot) -> list[str]:
    """Segments of the path to a place: names, and numbers from 1."""
    names: list[str] = []
    value: Any = document
    for key in spot.keys:
        if isinstance(key, str):
            names.append(key)
            value = (value or {}).get(key)
        else:
            value = value[key]
            names.append(_named_entry(value, key))
    return names


def _named_entry(entry: Any, k: int) -> str:
    """What a path calls an entry of a list: its name, or its number from 1."""
    return entry["name"] if isinstance(entry, dict) and "name" in entry else str(k + 1)


def _names(spot: _Spot) -> list[str]:
    """Valid next segments of a path."""
    if isinstance(spot.value, list):
        return [_named_entry(entry, k) for k, entry in enumerate(spot.value)]
    if spot.kind == "shares":
        return [*spot.value]
    return [key for key, rules in spot.rules.get("properties", {}).items() if _leads_on(rules)]


def _leads_on(rules: Mapping[str, Any]) -> bool:
    """Whether there is a number at or below a key."""
    if rules.get("$ref", "").endswith(("name", "/sign")):
        return False
    return "$ref" in rules or rules.get("type") in ("number", "array")


def _step(document: Document, spot: _Spot, segment: str, path: str) -> _Spot:
    """The place reached by the next segment."""
    rules = spot.rules.get("properties", {}).get(segment)
    if spot.kind == "shares" and segment in spot.value:
        rules = spot.rules["additionalProperties"]
    if isinstance(spot.value, list):
        for k, entry in enumerate(spot.value):
            if _named_entry(entry, k) == segment:
                return _spot((*spot.keys, k), entry, spot.rules.get("items", {}), spot.kind)
    elif rules is not None and _leads_on(rules):
        inside = spot.value if isinstance(spot.value, dict) else {}
        return _spot((*spot.keys, segment), inside.get(segment), rules, "")
    raise _unknown(document, spot, segment, _names(spot), path)


def _spot(keys: Keys, value: Any, rules: Mapping[str, Any], outer: str) -> _Spot:
    """A place, with the references of its rules resolved."""
    kind = ""
    definitions = schema()["$defs"]
    while "$ref" in rules:
        kind = rules["$ref"].rsplit("/", 1)[-1]
        if kind == "node" and isinstance(value, dict):
            kind = value["type"]
        if kind == "any_joint" and isinstance(value, dict):
            kind = "coupled_joint" if is_coupled(value) else "joint"
        rules = whole(definitions[kind])
    if kind == "profile" or outer == "profile":
        kind = "profile"
        if isinstance(value, dict):
            kind, rules = "term", definitions["term"]
        elif not isinstance(value, list):
            rules = {"type": "number"} if outer else {"type": "number", "exclusiveMinimum": 0}
    return _Spot(keys, value, rules, kind)


def _unknown(
    document: Document, spot: _Spot, segment: str, names: list[str], path: str
) -> UsageError:
    here = ".".join(_named(document, spot)) or "the robot file"
    if not names:
        return UsageError(f"{path}: {here} is a number, nothing follows after it")
    named = segment or "empty name"
    return UsageError(f"{path}: {here} has no {named!r}; {nearest(segment, names)}")


def _number(document: Document, path: str, parent: _Spot, spot: _Spot) -> Number:
    value, keys = spot.value, spot.keys
    if isinstance(value, bool) or not (value is None or isinstance(value, (int, float))):
        names = _names(spot)
        raise UsageError(
            f"{path} is not a number"
            + (f"; continue with one of {', '.join(names)}" if names else "")
        )
    if value is not None:
        return Number(path, keys, float(value), True, 1.0, spot.rules)
    if spot.rules.get("type") != "number":
        raise UsageError(f"{path} is not a number; continue with one of {', '.join(_names(spot))}")
    if parent.kind == "cable" and keys[-1] == "axial_stiffness":
        area = pi * parent.value["diameter"] ** 2 / 4.0
        modulus = parent.value["youngs_modulus"]
        return Number(path, (*keys[:-1], "youngs_modulus"), area * modulus, True, area, spot.rules)
    default = _default(document, parent, str(keys[-1]))
    return Number(path, keys, default, False, 1.0, spot.rules)


def _default(document: Document, parent: _Spot, key: str) -> float:
    if parent.kind == "friction":
        return _friction_default(document, parent.keys, key)
    if key == "bearing_stiffness":
        torque = (parent.value or {}).get("bearing_torque", 0.0)
        return float(torque) / DEFAULT_BREAKAWAY_ANGLE if torque else nan
    return DEFAULTS.get(parent.kind, {}).get(key, nan)


def _friction_default(document: Document, keys: Keys, key: str) -> float:
    """Value of the pulley, else of the cable, else of the robot; mu_s defaults to mu_c."""
    layers: list[Document] = [document.get("friction", {})]
    node: Any = document
    for step in keys[:-1]:
        node = node[step]
        if isinstance(node, dict):
            layers.append(node.get("friction", {}))
    wanted = (key, "mu_c") if key == "mu_s" else (key,)
    for name in wanted:
        for layer in reversed(layers):
            if name in layer:
                return float(layer[name])
    return DEFAULTS["friction"].get(key, nan)
