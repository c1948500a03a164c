"""Read YAML without unusual features, with the scanner of libyaml.

It reads a robot file twenty times as fast as ``ruamel.yaml``, whose scanner is written in Python.
The two differ in dialect (YAML 1.1 and 1.2) and in the wording of errors.  Therefore only what both
read alike is read here: mappings, lists, numbers, words, quoted texts and comments.  The rest is
left to ``ruamel.yaml``: errors, anchors, tags, escapes, marks of documents, tabs, block scalars,
repeated keys, and scalars that some version of YAML takes for something special.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import date
from typing import Any, Final

import yaml

_PARSER: Final[Any] = getattr(yaml, "CSafeLoader", None)
"""None where PyYAML was built without libyaml."""

_UNUSUAL: Final = re.compile(
    "[\x00-\x09\x0b-\x1f\\\\\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]"
)
"""Control characters, other line breaks than ``\\n``, and the backslash.

The complement, a set of almost all characters, would take 6 ms to compile.
"""

_CONSTANTS: Final = {
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
    "null": None, "Null": None, "NULL": None,
}  # fmt: skip
_INTEGER: Final = re.compile(r"-?(?:0|[1-9][0-9]{0,29})")
_REAL: Final = re.compile(r"-?(?:0|[1-9][0-9]*)(?:\.[0-9]*(?:[eE][-+]?[0-9]+)?|[eE][-+]?[0-9]+)")
_DATE: Final = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")
_TEXT: Final = re.compile(
    r"(?:[^\W0-9]|/|[0-9](?=.*[g-np-su-wyG-NP-SU-WY,%]|(?:[^-]*-){3}))"
    r"[\w./+,;()%=-]*(?: [\w./+,;()%=-]+)*"
)
"""Begins with a letter, or has what is part of no number or date: other letters or three dashes."""

_LONGEST_KEY: Final = 100
"""YAML limits the length of a key, with its blanks, to 1024 characters."""


class NotPlainError(Exception):
    """The text is not YAML, or is for ``ruamel.yaml`` to read."""


class TooDeepError(NotPlainError):
    """The text is nested too deep, which ``ruamel.yaml`` would find out slowly."""


def plain_yaml(text: str, most_nodes: int, most_depth: int) -> Any:
    """The value of a YAML text, equal to that which ``ruamel.yaml`` gives.

    Args:
        text: one document.
        most_nodes: scalars, lists and mappings that it may have.
        most_depth: depth of nesting that it may have.

    Raises:
        NotPlainError: see there.
    """
    if _PARSER is None or _UNUSUAL.search(text):
        raise NotPlainError
    try:
        return _Document(_PARSER(text).get_event, most_nodes).value(most_depth)
    except (yaml.YAMLError, ValueError):
        raise NotPlainError from None


def plain_nodes(text: str, most_nodes: int, most_depth: int) -> Any:
    """The nodes of a YAML text with their places in it, as ``ruamel.yaml`` composes them.

    Marks have ``index`` and ``column``; tags are those of YAML 1.1.

    Args:
        text, most_nodes, most_depth: as for ``plain_yaml``.

    Raises:
        NotPlainError: see there.
    """
    plain_yaml(text, most_nodes, most_depth)
    return _PARSER(text).get_single_node()


class _Document:
    """Builds the value from the events of libyaml's parser."""

    def __init__(self, event: Callable[[], Any], most_nodes: int) -> None:
        self._event = event
        self._left = most_nodes
        self._scalars: dict[str, Any] = dict(_CONSTANTS)

    def value(self, depth: int) -> Any:
        self._event()  # the start of the stream
        start = self._event()
        if type(start) is not yaml.DocumentStartEvent or start.explicit:
            raise NotPlainError
        value = self._node(self._event(), depth)
        end, last = self._event(), self._event()
        if end.explicit or type(last) is not yaml.StreamEndEvent:
            raise NotPlainError
        return value

    def _node(self, event: Any, depth: int) -> Any:
        """The value that begins with an event, with at most ``depth`` levels."""
        self._left -= 1
        kind = type(event)
        if depth == 0:
            raise TooDeepError
        if self._left < 0:
            raise NotPlainError
        if event.anchor is not None or event.tag is not None:  # also an alias
            raise NotPlainError
        if kind is yaml.ScalarEvent:
            return self._scalar(event)
        return self._sequence(depth) if kind is yaml.SequenceStartEvent else self._mapping(depth)

    def _sequence(self, depth: int) -> list[Any]:
        items = []
        while type(event := self._event()) is not yaml.SequenceEndEvent:
            items.append(self._node(event, depth - 1))
        return items

    def _mapping(self, depth: int) -> dict[str, Any]:
        entries: dict[str, Any] = {}
        while type(event := self._event()) is not yaml.MappingEndEvent:
            if type(event) is not yaml.ScalarEvent:
                raise NotPlainError
            key = self._node(event, depth - 1)
            if type(key) is not str or len(key) > _LONGEST_KEY or key in entries:
                raise NotPlainError
            entries[key] = self._node(self._event(), depth - 1)
        return entries

    def _scalar(self, event: Any) -> Any:
        text = event.value
        if event.style in {"'", '"'}:
            return text
        if event.style:
            raise NotPlainError
        if text not in self._scalars:
            self._scalars[text] = _plain_scalar(text)
        return self._scalars[text]


def _plain_scalar(text: str) -> int | float | date | str:
    """The value of a scalar without quotes."""
    if _TEXT.fullmatch(text):
        return text
    if _REAL.fullmatch(text):
        return float(text)
    if _INTEGER.fullmatch(text):
        return int(text)
    if _DATE.fullmatch(text):
        return date.fromisoformat(text)
    raise NotPlainError
