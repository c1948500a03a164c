"""YAML text to a validated document: plain containers, SI keys, every key known to the schema."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import lru_cache
from importlib import resources
from math import pi
from typing import Any, Final

import jsonschema
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from cdrj_ros.foundation.errors import RobotFileError

UNIT_SUFFIXES: Final[Mapping[str, float]] = {"_deg": pi / 180.0, "_mm": 1e-3, "_gpa": 1e9}
"""Keys may end in one of these; the value is multiplied on reading."""

IN_THE_UNIT: Final = ("value", "offset", "slope", "sine")
"""Keys of a function of a joint that carry the unit of the key around it."""

LARGEST: Final = 1e15
"""Numbers beyond this, in SI, describe no robot."""

MAXIMUM_ENTRIES: Final = 100_000
MAXIMUM_DEPTH: Final = 12

Document = dict[str, Any]


def parse_document(text: str, source: str) -> Document:
    """The validated document of a YAML text, in SI units.

    Raises:
        RobotFileError: with one line that names the key, what was given and what is allowed.
    """
    try:
        raw = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        reason = " ".join(str(error).split("To suppress")[0].split())
        raise RobotFileError(f"{source} is not YAML: {reason[:300]}") from error
    except (RecursionError, ValueError) as error:
        raise RobotFileError(f"{source} is not YAML: {error}") from error
    if not isinstance(raw, dict):
        raise RobotFileError(f"{source} must hold a mapping with motors, joints and cables")
    try:
        document: Document = _Reading(source).to_si(raw)
    except ValueError as error:  # an integer that Python does not write out
        raise RobotFileError(f"{source} holds an integer of thousands of digits") from error
    for complaint in complaints(document, schema()):
        raise RobotFileError(f"{complaint} ({source})")
    return document


@lru_cache(maxsize=1)
def schema() -> Document:
    """The JSON schema of the robot file."""
    text = resources.files("cdrj_ros.robot").joinpath("robot.schema.json").read_text("utf-8")
    document: Document = json.loads(text)
    return document


def term_schema() -> Document:
    """The part of the schema that describes a function of one joint."""
    return {"$ref": "#/$defs/term", "$defs": schema()["$defs"]}


def complaints(value: Any, rules: Document, path: str = "") -> Iterable[str]:
    """One line for each way in which ``value``, found at ``path``, breaks the rules."""
    validator = jsonschema.Draft202012Validator(rules)
    for error in sorted(validator.iter_errors(value), key=lambda error: len(error.path)):
        yield _complaint(error, path)


class _Reading:
    """Plain containers with SI keys, within bounds that no honest file comes near."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.entries = 0

    def error(self, path: str, text: str) -> RobotFileError:
        return RobotFileError(f"{path or 'the file'} {text} ({self.source})")

    def to_si(self, value: Any, path: str = "", depth: int = 0) -> Any:
        """The same value with its units applied; an alias counts each time it is used."""
        self.entries += 1
        if self.entries > MAXIMUM_ENTRIES or depth > MAXIMUM_DEPTH:
            raise self.error(path, "is nested or repeated beyond any robot")
        if isinstance(value, dict):
            return self._mapping(value, path, depth)
        if isinstance(value, list):
            return [self.to_si(one, f"{path}[{k}]", depth + 1) for k, one in enumerate(value)]
        return self._checked(value, path)

    def _mapping(self, value: dict[Any, Any], path: str, depth: int) -> Document:
        result: Document = {}
        for key, entry in value.items():
            here = f"{path}.{key}" if path else str(key)
            name, factor = _split_unit(str(key))
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

    def _checked(self, value: Any, path: str) -> Any:
        if isinstance(value, (int, float)) and not -LARGEST <= value <= LARGEST:
            raise self.error(
                path, f"must be a finite number of at most {LARGEST:g}, got {_shown(value)}"
            )
        return value

    def _refuse_second_unit(self, entry: dict[Any, Any], path: str) -> None:
        for key in entry:
            name, factor = _split_unit(str(key))
            if factor != 1.0 and name in IN_THE_UNIT:
                raise self.error(f"{path}.{key}", "has a unit already, that of the key around it")

    def _scaled(self, value: Any, factor: float, path: str) -> Any:
        if isinstance(value, list):
            return [self._scaled(entry, factor, path) for entry in value]
        if isinstance(value, dict):  # a function of a joint: its values carry the unit
            return {
                key: self._scaled(entry, factor, path) if key in IN_THE_UNIT else entry
                for key, entry in value.items()
            }
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(path, f"must be a number, got {_shown(value)}")
        return self._checked(value * factor, path)


def _split_unit(key: str) -> tuple[str, float]:
    for suffix, factor in UNIT_SUFFIXES.items():
        if key.endswith(suffix):
            return key[: -len(suffix)], factor
    return key, 1.0


def _path(start: str, parts: Iterable[str | int]) -> str:
    text = start
    for part in parts:
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{part}"
    return text


def _complaint(error: Any, start: str) -> str:
    """One line for a schema error: path of the key, what was given, what is allowed."""
    where = _path(start, error.absolute_path)
    given = error.instance
    what = error.validator
    allowed = error.validator_value
    if what == "additionalProperties":
        known = sorted(error.schema["properties"])
        unknown = next(key for key in given if key not in error.schema["properties"])
        close = get_close_matches(unknown, known, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"known keys: {', '.join(known)}"
        return f"{_path(start, [*error.absolute_path, unknown])} is not a known key; {hint}"
    if what == "required":
        missing = next(key for key in allowed if key not in given)
        described = error.schema["properties"].get(missing, {}).get("description", "")
        return f"{_path(start, [*error.absolute_path, missing])} is missing: {described}".rstrip(
            ": "
        )
    limits = {
        "minimum": "at least",
        "exclusiveMinimum": "greater than",
        "maximum": "at most",
        "exclusiveMaximum": "less than",
    }
    if what in limits:
        return f"{where} must be {limits[what]} {allowed:g}, got {_shown(given)}"
    if what == "enum":
        return f"{where} must be one of {', '.join(map(str, allowed))}, got {_shown(given)}"
    if what == "type":
        return f"{where or 'the file'} must be of type {allowed}, got {_shown(given)}"
    if what == "minItems":
        return f"{where} needs at least {allowed} entries, got {len(given)}"
    if what == "maxItems":
        return f"{where} may have {allowed} entries, got {len(given)}"
    if what == "pattern":
        return f"{where} must be a name of letters, digits and _, got {_shown(given)}"
    described = error.schema.get("description", error.message)
    return f"{where} must be: {described} Got {_shown(given)}"


def _shown(value: Any) -> str:
    text = f"{value:.3e}" if isinstance(value, float) and abs(value) > LARGEST else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
