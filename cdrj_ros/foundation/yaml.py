"""Read untrusted YAML in bounded time and memory.

The syntax is that of libyaml, the types of scalars are those of YAML 1.2 (core schema): ``yes`` is
a text, ``1e3`` a number, and so is ``1_000``.  Aliases and merge keys are followed, up to the
limits below.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import yaml

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.output import printable

MAXIMUM_CHARACTERS: Final = 1_000_000
"""Maximum length of a text."""
MAXIMUM_NODES: Final = 100_000
"""Maximum number of scalars, sequences and mappings after expansion of aliases and merge keys: a
kilobyte of nested aliases can expand to billions."""
MAXIMUM_DEPTH: Final = 50
"""Maximum depth of nesting, including aliases, since users of the result may recurse."""
MAXIMUM_DIGITS: Final = 300
"""Maximum length of an integer, close to the largest double; Python does not print thousands of
digits."""

_LOADER: Final[Any] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""In C, or in Python where PyYAML was built without libyaml."""

_TAG: Final = "tag:yaml.org,2002:"
_TYPES: Final = {"int": int, "float": float, "bool": bool, "null": type(None)}
_CONSTANTS: Final = {
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
}
_DIGITS: Final = "[0-9](?:_?[0-9])*"
_INTEGER: Final = re.compile(rf"[-+]?{_DIGITS}|0o[0-7]+|0x[0-9a-fA-F]+")
_REAL: Final = re.compile(
    rf"[-+]?(?:\.{_DIGITS}|{_DIGITS}(?:\.(?:{_DIGITS})?)?)(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
)


Document = dict[str, Any]
"""A mapping of plain containers: the content of a robot file, or of an entry in it."""


class YamlError(CdrjError):
    """A text that is not valid YAML or exceeds a limit of this module."""


def load_yaml(text: str, source: str) -> Any:
    """The value of a YAML text: dicts, lists, strings, numbers, booleans and None.

    Aliases refer to the same object.  No value contains itself.

    Args:
        text: one YAML document.
        source: the file's name, for the error.

    Raises:
        YamlError: one line that names the source and the first error.
    """
    try:
        if len(text) > MAXIMUM_CHARACTERS:
            raise YamlError(f"has {len(text)} characters, at most {MAXIMUM_CHARACTERS}")
        try:
            return _Document(text).value()
        except yaml.MarkedYAMLError as error:
            where = f" in line {error.problem_mark.line + 1}" if error.problem_mark else ""
            raise YamlError(f"is not YAML: {error.problem}{where}") from None
        except (yaml.YAMLError, ValueError) as error:  # characters that YAML does not allow
            raise YamlError(f"is not YAML: {' '.join(str(error).split())[:300]}") from None
    except YamlError as error:
        raise YamlError(f"{printable(source)} {error}") from None


def yaml_text(document: Any, *, block: bool = False) -> str:
    """A document of mappings, lists, texts and numbers as YAML.

    Args:
        document: what is written.
        block: whether every entry has a line of its own; otherwise short lists share one.
    """
    style = {"default_flow_style": False, "width": 4096} if block else {"default_flow_style": None}
    text: str = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, **style)
    return text


def yaml_flow(value: Any) -> str:
    """A value of mappings, lists, texts and numbers as YAML in one line."""
    text: str = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=float("inf")
    )
    return text.removesuffix("...\n").rstrip()


def yaml_nodes(text: str) -> Any:
    """The nodes of a text that ``load_yaml`` accepts, with their places in it.

    They have ``id`` (``scalar``, ``sequence``, ``mapping``), ``value``, ``start_mark`` and
    ``end_mark``; marks have ``index`` and ``column``.
    """
    return yaml.compose(text, Loader=_LOADER)


@dataclass(frozen=True)
class _Part:
    """A value with its size when all aliases are expanded."""

    value: Any
    nodes: int = 1
    depth: int = 1


class _Document:
    """Builds the value of a text from the events of the parser."""

    def __init__(self, text: str) -> None:
        self._events: Iterator[Any] = yaml.parse(text, Loader=_LOADER)
        self._anchors: dict[str, _Part | None] = {}
        self._parsed = 0

    def value(self) -> Any:
        """The value of the only document; None if there is none."""
        next(self._events)  # the start of the stream
        start = next(self._events)
        if isinstance(start, yaml.StreamEndEvent):
            return None
        if start.version not in (None, (1, 2)):
            raise YamlError("is not YAML: a %YAML directive must be 1.2")
        part = self._part(next(self._events), 1)
        next(self._events)  # the end of the document
        if not isinstance(next(self._events), yaml.StreamEndEvent):
            raise YamlError("is not YAML: it has more than one document")
        return part.value

    def _part(self, event: Any, level: int) -> _Part:
        self._parsed += 1
        if self._parsed > MAXIMUM_NODES:
            raise YamlError(f"has more than {MAXIMUM_NODES} entries")
        if level > MAXIMUM_DEPTH:
            raise YamlError(f"is nested more than {MAXIMUM_DEPTH} deep")
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, level)
        if event.anchor is not None:
            self._anchors[event.anchor] = None  # until it ends
        if isinstance(event, yaml.ScalarEvent):
            part = _Part(_scalar(event))
        elif isinstance(event, yaml.SequenceStartEvent):
            part = self._sequence(event, level)
        else:
            part = self._mapping(event, level)
        if part.nodes > MAXIMUM_NODES:
            raise YamlError(f"repeats aliases to more than {MAXIMUM_NODES} entries")
        if event.anchor is not None:
            self._anchors[event.anchor] = part
        return part

    def _alias(self, event: Any, level: int) -> _Part:
        if event.anchor not in self._anchors:
            raise YamlError(f"is not YAML: no anchor for *{event.anchor}{_line(event)}")
        part = self._anchors[event.anchor]
        if part is None:
            raise YamlError("contains an alias of the mapping or list it stands in")
        if level + part.depth - 1 > MAXIMUM_DEPTH:
            raise YamlError(f"is nested more than {MAXIMUM_DEPTH} deep by aliases")
        return part

    def _sequence(self, event: Any, level: int) -> _Part:
        _check_tag(event, "seq")
        items: list[Any] = []
        nodes, depth = 1, 0
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            part = self._part(event, level + 1)
            items.append(part.value)
            nodes, depth = nodes + part.nodes, max(depth, part.depth)
        return _Part(items, nodes, depth + 1)

    def _mapping(self, event: Any, level: int) -> _Part:
        _check_tag(event, "map")
        entries: dict[Hashable, Any] = {}
        merged: dict[Hashable, Any] = {}
        nodes, depth = 1, 0
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            merges = isinstance(event, yaml.ScalarEvent) and event.value == "<<" and not event.style
            key = self._part(event, level + 1)
            value = self._part(next(self._events), level + 1)
            nodes, depth = nodes + key.nodes + value.nodes, max(depth, key.depth, value.depth)
            if merges:
                for one in value.value if isinstance(value.value, list) else [value.value]:
                    if not isinstance(one, dict):
                        raise YamlError(f"is not YAML: << needs a mapping{_line(event)}")
                    merged = {**one, **merged}
            elif isinstance(key.value, (dict, list)):
                raise YamlError(f"is not YAML: a key must be a scalar{_line(event)}")
            elif key.value in entries:
                shown = repr(key.value)[:50]
                raise YamlError(f"is not YAML: the key {shown} is given twice{_line(event)}")
            else:
                entries[key.value] = value.value
        return _Part({**merged, **entries}, nodes, depth + 1)


def _line(event: Any) -> str:
    return f" in line {event.start_mark.line + 1}"


def _check_tag(event: Any, kind: str) -> None:
    if event.tag not in (None, "!", _TAG + kind):
        raise YamlError(f"is not YAML: the tag {event.tag[:50]} is unknown{_line(event)}")


def _scalar(event: Any) -> Any:
    """Value of a scalar: a text if it is quoted, else by its form, which a tag must confirm."""
    text: str = event.value
    tag = (event.tag or "").removeprefix(_TAG)
    if tag in ("!", "str") or (event.style and not tag):
        return text
    value = _plain(text)
    if not tag:
        return value
    if tag not in _TYPES:
        raise YamlError(f"is not YAML: the tag {tag[:50]} is unknown{_line(event)}")
    if tag == "float" and type(value) is int:
        return float(value)
    if type(value) is not _TYPES[tag]:
        raise YamlError(f"is not YAML: {text[:50]!r}{_line(event)} is no {tag}, as its tag says")
    return value


def _plain(text: str) -> Any:
    """Value of a scalar without quotes, by the core schema of YAML 1.2."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INTEGER.fullmatch(text):
        if len(text) > MAXIMUM_DIGITS:
            raise YamlError(f"holds an integer of {len(text)} digits")
        return int(text, 0 if text[:2] in ("0o", "0x") else 10)
    if _REAL.fullmatch(text):
        return float(text.replace(".", "") if text[-1].isalpha() else text)
    return text
