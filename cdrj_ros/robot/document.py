"""Parsing of YAML text into a validated document of plain containers in SI units."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from math import pi
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from cdrj_ros.foundation.errors import RobotFileError, nearest
from cdrj_ros.foundation.files import InputError, read_regular
from cdrj_ros.foundation.yaml import Document, YamlError, load_yaml, yaml_nodes
from cdrj_ros.robot.names import with_prefix
from cdrj_ros.robot.parts import errors_in_parts, expanded
from cdrj_ros.robot.urdf import with_urdf_frames

UNIT_SUFFIXES: Final[Mapping[str, float]] = MappingProxyType(
    {"_deg": pi / 180.0, "_mm": 1e-3, "_gpa": 1e9}
)
"""Unit suffixes of keys and the factors by which values are multiplied on reading."""

IN_THE_UNIT: Final = ("value", "offset", "slope", "sine")
"""Keys of a function of a joint whose values have the unit of the enclosing key."""

LARGEST: Final = 1e15
"""Largest magnitude of a number in SI, for keys to which the schema sets no narrower limit."""

MAXIMUM_DEPTH: Final = 12
"""Largest accepted depth of nesting; the schema needs less."""

MAXIMUM_BYTES: Final = 1_000_000
"""Largest accepted size of a file [bytes]."""


def read_text(path: str | Path, kind: str) -> str:
    """Text of a YAML file; ``kind`` says what the file is, for errors.

    Raises:
        RobotFileError: it cannot be read, is too large, or is not UTF-8.
    """
    try:
        return read_regular(path, MAXIMUM_BYTES).decode()
    except InputError as error:
        raise RobotFileError(f"cannot read the {kind} {path}: {error}") from error
    except UnicodeDecodeError as error:
        raise RobotFileError(f"{path} is not UTF-8 text") from error


def parse_document(text: str, source: str) -> Document:
    """The validated document of a YAML text, in SI units.

    Raises:
        RobotFileError: with one line that names the key, what was given and what is allowed.
    """
    with explained(text, source):
        document = file_document(text, source)
        if "parts" in document:
            for complaint in _complaints(_validator("parts"), document["parts"], "parts"):
                raise RobotFileError(f"{complaint} ({source})")
            document = expanded(document, source)
        document = with_urdf_frames(with_prefix(document), source)
        _check(document, _validator(), source)
    return document


def file_document(text: str, source: str) -> Document:
    """A robot file as it stands, in SI: with its parts, and not validated.

    Raises:
        RobotFileError: as ``si_document``.
    """
    return si_document(text, source, "motors, joints and cables")


@contextmanager
def explained(text: str, source: str) -> Iterator[None]:
    """Let errors about entries that come from parts of a robot file say where in its text."""

    def line(keys: Sequence[str | int]) -> int:
        node = yaml_nodes(text)
        for key in keys:
            if isinstance(key, int):
                listed = node.id == "sequence" and key < len(node.value)
                node = node.value[key] if listed else node
            elif found := entry_node(node, key):
                node = found[1]
        return int(node.start_mark.line) + 1

    with errors_in_parts(lambda: file_document(text, source), line):
        yield


def entry_node(mapping: Any, key: str) -> tuple[str, Any] | None:
    """Key as written, including its unit suffix, and the node of its value.

    Args:
        mapping: a node of ``yaml_nodes``.
        key: the key without suffix.
    """
    if mapping.id == "mapping":
        for name, value in mapping.value:
            if name.value == key or any(name.value == key + suffix for suffix in UNIT_SUFFIXES):
                return str(name.value), value
    return None


def si_document(text: str, source: str, content: str) -> Document:
    """A YAML text as plain containers in SI units.

    Args:
        text: the text.
        source: name of its file.
        content: what the file holds, for the error.

    Raises:
        RobotFileError: it is not a mapping, or a number has two units.
    """
    document: Document = _Reading(source).to_si(yaml_mapping(text, source, content))
    return document


def yaml_mapping(text: str, source: str, content: str) -> Document:
    """A YAML text that is a mapping, as ``si_document`` without units in keys."""
    try:
        raw = load_yaml(text, source)
    except YamlError as error:
        raise RobotFileError(str(error)) from error
    if not isinstance(raw, dict):
        raise RobotFileError(f"{source} must hold a mapping with {content}")
    return raw


def check_document(document: Document, schema: Mapping[str, Any], source: str) -> None:
    """Refuse a document that violates a JSON schema, or has impossible numbers.

    Args:
        document: of ``si_document`` or ``yaml_mapping``.
        schema: see ``load_schema``.
        source: name of the file.

    Raises:
        RobotFileError: with one line that names the key, what was given and what is allowed.
    """
    import jsonschema  # takes 65 ms, which not every command needs

    _check(document, jsonschema.Draft202012Validator(schema), source)


def _check(document: Document, validator: Any, source: str) -> None:
    for complaint in _complaints(validator, document, ""):
        raise RobotFileError(f"{complaint} ({source})")
    for path, value in _impossible(document, ""):
        raise RobotFileError(
            f"{path} must be a finite number of at most {LARGEST:g} in SI, got {_shown(value)} "
            f"({source})"
        )


@lru_cache
def load_schema(package: str, name: str) -> Document:
    """A JSON schema among the files of a package; shared, must not be modified."""
    document: Document = json.loads(resources.files(package).joinpath(name).read_text("utf-8"))
    return document


def schema() -> Mapping[str, Any]:
    """The JSON schema of the robot file."""
    return load_schema("cdrj_ros.robot", "robot.schema.json")


def whole(part: Mapping[str, Any]) -> Mapping[str, Any]:
    """A part of the schema, with the rules of its keys where these are some keys of another one."""
    if not {"$ref", "propertyNames"} <= part.keys():
        return part
    every = schema()["$defs"][part["$ref"].rpartition("/")[2]]["properties"]
    own = part.get("properties", {})
    keys = {key: {**every[key], **own.get(key, {})} for key in part["propertyNames"]["enum"]}
    return {**{key: rule for key, rule in part.items() if key != "$ref"}, "properties": keys}


@lru_cache(maxsize=2)
def _validator(key: str = "") -> Any:
    """The validator of the schema, or of one key of the file."""
    import jsonschema  # as in check_document

    rules = schema()
    if key:
        rules = {**rules["properties"][key], "$defs": rules["$defs"]}
    return jsonschema.Draft202012Validator(rules)


def document_complaints(document: Document) -> Iterator[str]:
    """One line for each violation of the schema in a document."""
    return _complaints(_validator(), document, "")


def _complaints(validator: Any, value: Any, path: str) -> Iterator[str]:
    errors = sorted(validator.iter_errors(value), key=lambda error: len(error.path))
    return (_complaint(error, path) for error in errors)


def _impossible(value: Any, path: str) -> Iterator[tuple[str, float]]:
    """Path and value of every number that is not finite or exceeds ``LARGEST`` in magnitude."""
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from _impossible(entry, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            yield from _impossible(entry, f"{path}[{k}]")
    elif isinstance(value, (int, float)) and not -LARGEST <= value <= LARGEST:
        yield path, value


class _Reading:
    """Converts the output of the YAML loader to plain containers with keys and values in SI."""

    def __init__(self, source: str) -> None:
        self.source = source

    def error(self, path: str, text: str) -> RobotFileError:
        return RobotFileError(f"{path or 'the file'} {text} ({self.source})")

    def to_si(self, value: Any, path: str = "", depth: int = 0) -> Any:
        """Deep copy of the value converted to SI; aliased parts are copied as well."""
        if depth > MAXIMUM_DEPTH:
            raise self.error(path, f"is nested more than {MAXIMUM_DEPTH} deep")
        if isinstance(value, dict):
            return self._mapping(value, path, depth)
        if isinstance(value, list):
            return [self.to_si(one, f"{path}[{k}]", depth + 1) for k, one in enumerate(value)]
        return value

    def _mapping(self, value: dict[Any, Any], path: str, depth: int) -> Document:
        result: Document = {}
        for key, entry in value.items():
            here = f"{path}.{key}" if path else str(key)
            name, factor = split_unit(str(key))
            converted = self.to_si(entry, here, depth + 1)
            if factor != 1.0:
                for term in entry if isinstance(entry, list) else [entry]:
                    if isinstance(term, dict):
                        self._refuse_second_unit(term, here)
                converted = self._scaled(converted, factor, here)
            if name in result:
                raise self.error(here, "is given twice, in different units")
            result[name] = converted
        return result

    def _refuse_second_unit(self, entry: dict[Any, Any], path: str) -> None:
        for key in entry:
            name, factor = split_unit(str(key))
            if factor != 1.0 and name in IN_THE_UNIT:
                raise self.error(f"{path}.{key}", "has a unit already: that of the enclosing key")

    def _scaled(self, value: Any, factor: float, path: str) -> Any:
        if isinstance(value, list):
            return [self._scaled(entry, factor, path) for entry in value]
        if isinstance(value, dict):  # a function of a joint: the unit applies to its values
            return {
                key: self._scaled(entry, factor, path) if key in IN_THE_UNIT else entry
                for key, entry in value.items()
            }
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(path, f"must be a number, got {_shown(value)}")
        try:
            return value * factor
        except OverflowError:  # an integer beyond the range of floats
            raise self.error(path, f"must be at most {LARGEST:g} in SI") from None


def split_unit(key: str) -> tuple[str, float]:
    """A key without its unit suffix, and the factor to SI."""
    for suffix, factor in UNIT_SUFFIXES.items():
        if key.endswith(suffix):
            return key[: -len(suffix)], factor
    return key, 1.0


def _path(start: str, parts: Iterable[str | int]) -> str:
    text = start
    for part in parts:
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{part}"
    return text


ELSEWHERE: Final = MappingProxyType(
    {
        "a gear of ratio N between encoder and axis is scale: 1/N, as a number, of its motor or "
        "joint; negative if it reverses the sense": (
            "gear", "gear_ratio", "mechanical_reduction", "ratio", "reduction", "transmission",
        ),
        "the unit of the published positions is scale of the motor or joint: scale_deg: 360 for "
        "turns, 360 / counts per turn for counts, 1 for degrees": (
            "counts_per_revolution", "counts_per_turn", "cpr", "encoder_resolution",
            "position_unit", "ticks_per_turn", "unit", "units",
        ),
        "a current as effort is effort_scale of the motor or joint: torque constant [N m/A] * gear "
        "ratio * efficiency": (
            "current_to_torque", "efficiency", "gear_efficiency", "kt", "motor_constant",
            "torque_constant",
        ),
        "a sensor that counts the other way is a negative scale, an effort of the other sign "
        "effort_sign: -1": ("direction", "invert", "inverted", "polarity", "reverse", "sign"),
        "the angle at reading 0 is offset": (
            "home", "home_offset", "homing_offset", "zero", "zero_offset",
        ),
        "name is the name as published, after prefix, a key of the file itself": (
            "joint_name", "name_prefix", "namespace", "prefix", "published_name", "ros_name",
            "tf_prefix",
        ),
    }
)  # fmt: skip
"""What to write for a key of another program, with its names there."""

LIMITS: Final = MappingProxyType(
    {
        "minimum": "at least",
        "exclusiveMinimum": "greater than",
        "maximum": "at most",
        "exclusiveMaximum": "less than",
    }
)
"""Words for the schema's limits of a number."""


def _complaint(error: Any, start: str) -> str:
    """One line for a schema error: path of the key, what was given, what is allowed."""
    if error.validator == "required":
        missing = next(key for key in error.validator_value if key not in error.instance)
        described = whole(error.schema)["properties"].get(missing, {}).get("description", "")
        path = _path(start, [*error.absolute_path, missing])
        return f"{path} is missing: {described}".rstrip(": ")
    if error.validator == "additionalProperties":
        known = error.schema["properties"]
        return _unknown_key(
            error, start, next(key for key in error.instance if key not in known), known
        )
    if error.validator == "enum" and "propertyNames" in error.absolute_schema_path:
        return _unknown_key(error, start, error.instance, error.validator_value)
    where, rule, allowed = _path(start, error.absolute_path), error.validator, error.validator_value
    given = error.instance
    if rule in ("minItems", "maxItems"):
        bound = "needs at least" if rule == "minItems" else "may have"
        return f"{where} {bound} {allowed} entries, got {len(given)}"
    if rule in LIMITS:
        wanted = f"{LIMITS[rule]} {allowed:g},"
    elif rule == "enum":
        wanted = f"one of {', '.join(map(str, allowed))},"
    elif rule == "type":
        where, wanted = where or "the file", f"of type {allowed},"
    elif rule == "pattern":
        wanted = f"{error.schema['description']},"
    else:
        return (
            f"{where} must be: {error.schema.get('description', error.message)} Got {_shown(given)}"
        )
    return f"{where} must be {wanted} got {_shown(given)}"


def _unknown_key(error: Any, start: str, unknown: str, known: Iterable[str]) -> str:
    """One line for a key that is none of the known ones."""
    elsewhere = (words for words, keys in ELSEWHERE.items() if unknown in keys)
    hint = next(elsewhere, nearest(unknown, sorted(known)))
    return f"{_path(start, [*error.absolute_path, unknown])} is not a known key; {hint}"


def _shown(value: Any) -> str:
    text = f"{value:.3e}" if isinstance(value, float) and abs(value) > LARGEST else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


@dataclass(frozen=True)
class Range:
    """The numbers that the schema allows for a key [SI]."""

    lower: float
    upper: float
    open_below: bool
    """Whether ``lower`` itself is excluded."""
    open_above: bool
    """Whether ``upper`` itself is excluded."""

    def __contains__(self, value: float) -> bool:
        """Whether a number is allowed; NaN is not."""
        above = value > self.lower if self.open_below else value >= self.lower
        below = value < self.upper if self.open_above else value <= self.upper
        return above and below


def allowed_range(rules: Mapping[str, Any]) -> Range:
    """Range of a number from its part of the schema, within ±``LARGEST``."""
    return Range(
        float(rules.get("exclusiveMinimum", rules.get("minimum", -LARGEST))),
        float(rules.get("exclusiveMaximum", rules.get("maximum", LARGEST))),
        "exclusiveMinimum" in rules,
        "exclusiveMaximum" in rules,
    )
