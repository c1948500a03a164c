"""Check of a document against a JSON schema that answers "it satisfies it" or "perhaps not".

``jsonschema`` says what is wrong, but takes twenty times as long for a document without errors, and
a tenth of a second to import.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from math import inf
from typing import Any, Final

Rules = dict[str, Any]
Check = Callable[[Any], bool]

WITHOUT_RULES: Final = frozenset({"$schema", "$defs", "title", "description"})
"""Keys of a schema that state no rule."""


def quick_check(rules: Rules) -> Check:
    """A function that is true only for values that satisfy the schema.

    It is false for some others that do: NaN, and instances of subclasses.

    Args:
        rules: a schema of draft 2020-12; references lead to its own ``$defs``.

    Raises:
        ValueError, LookupError: the schema has a rule that this module does not know.
    """
    return _Compilation(rules.get("$defs", {})).check(rules)


class _Compilation:
    """Makes the checks of a schema and of its parts; every method removes the rules it checks."""

    def __init__(self, definitions: Rules) -> None:
        self._definitions = definitions
        self._known: dict[str, Check] = {}

    def check(self, rules: Rules) -> Check:
        """The check of one part."""
        left = {key: value for key, value in rules.items() if key not in WITHOUT_RULES}
        makers = {
            "type": self._type,
            "enum": _one_of,
            "const": _one_of,
            "$ref": self._reference,
            "anyOf": self._any_of,
            "allOf": self._by_type,
        }
        checks = [make(left) for key, make in makers.items() if key in left]
        if left or not checks:
            raise ValueError(f"no quick check of {left or rules}")
        return checks[0] if len(checks) == 1 else lambda value: all(one(value) for one in checks)

    def _type(self, left: Rules) -> Check:
        makers: dict[str, Callable[[Rules], Check]] = {
            "object": self._mapping,
            "array": self._list,
            "number": _number,
            "string": _string,
            "integer": _integer,
            "boolean": lambda _: lambda value: type(value) is bool,
        }
        return makers[left.pop("type")](left)

    def _mapping(self, left: Rules) -> Check:
        known = {key: self.check(rules) for key, rules in left.pop("properties", {}).items()}
        others = left.pop("additionalProperties", True)
        other = self.check(others) if isinstance(others, dict) else lambda _: bool(others)
        required, most = set(left.pop("required", ())), left.pop("maxProperties", inf)
        partners = {key: set(more) for key, more in left.pop("dependentRequired", {}).items()}

        def check(value: Any) -> bool:
            if type(value) is not dict or len(value) > most or not value.keys() >= required:
                return False
            if any(key in value and not value.keys() >= more for key, more in partners.items()):
                return False
            return all(known.get(key, other)(entry) for key, entry in value.items())

        return check

    def _list(self, left: Rules) -> Check:
        entry = self.check(left.pop("items"))
        least, most = left.pop("minItems", 0), left.pop("maxItems", inf)
        return lambda value: (
            type(value) is list and least <= len(value) <= most and all(map(entry, value))
        )

    def _reference(self, left: Rules) -> Check:
        name = left.pop("$ref").removeprefix("#/$defs/")
        if name not in self._known:
            self._known[name] = self.check(self._definitions[name])
        return self._known[name]

    def _any_of(self, left: Rules) -> Check:
        checks = [self.check(rules) for rules in left.pop("anyOf")]
        return lambda value: any(check(value) for check in checks)

    def _by_type(self, left: Rules) -> Check:
        """Rules of the form: if ``type`` is this, then that; false where it is none of them."""
        found: dict[str, Check] = {}
        for rules in left.pop("allOf"):
            kind = rules["if"]["properties"]["type"]["const"]
            found[kind] = self.check(rules["then"])
            if rules != {
                "if": {"properties": {"type": {"const": kind}}},
                "then": rules["then"],
            }:
                raise ValueError(f"no quick check of {rules}")

        def check(value: Any) -> bool:
            kind = value.get("type") if type(value) is dict else None
            return type(kind) is str and kind in found and found[kind](value)

        return check


def _one_of(left: Rules) -> Check:
    allowed = left.pop("enum") if "enum" in left else [left.pop("const")]
    pairs = {(type(one), one) for one in allowed}  # True equals 1
    types = {kind for kind, _ in pairs}
    return lambda value: type(value) in types and (type(value), value) in pairs


def _number(left: Rules) -> Check:
    least, above = left.pop("minimum", -inf), left.pop("exclusiveMinimum", -inf)
    most, below = left.pop("maximum", inf), left.pop("exclusiveMaximum", inf)
    return lambda value: (
        (type(value) is float or type(value) is int)
        and least <= value <= most
        and above < value < below
    )


def _integer(left: Rules) -> Check:
    within = _number(left)
    return lambda value: type(value) is int and within(value)


def _string(left: Rules) -> Check:
    pattern, most = re.compile(left.pop("pattern", "")), left.pop("maxLength", inf)
    return lambda value: type(value) is str and len(value) <= most and bool(pattern.search(value))
