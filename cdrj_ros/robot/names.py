"""Names of motors and joints as messages have them: those of the file after its prefix."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Final, TypeVar

from cdrj_ros.foundation.output import printable
from cdrj_ros.foundation.yaml import Document

NAMED_KINDS: Final = ("motors", "joints", "frames", "cables")
"""Lists of a robot file whose entries have names."""

_KINDS: Final = ("motors.", "joints.", "effort/")
"""Beginnings of paths of numbers of motors and joints, and of channels of their efforts."""


PREFIX: Final[ContextVar[str]] = ContextVar("prefix", default="")
"""Prefix of the robot files that are read; empty: their own."""

Value = TypeVar("Value")


@contextmanager
def given(variable: ContextVar[Value], value: Value) -> Iterator[None]:
    """Let robot files be read with another value of the variable within the context."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def prefixed(name: str, prefix: str) -> str:
    """The name after the prefix; a name that begins with it stays."""
    return name if name.startswith(prefix) else prefix + name


def known_name(name: str, names: Collection[str], document: Mapping[str, Any]) -> str:
    """A name as messages have it, given so or as the robot file has it, without its prefix.

    Args:
        name: as given.
        names: those that there are.
        document: content of the robot file.
    """
    longer = prefixed(name, str(document.get("prefix", "")))
    return longer if name not in names and longer in names else name


def naming_hint(names: Sequence[str], missing: Sequence[str], document: Mapping[str, Any]) -> str:
    """What would make every missing name one of the names, in words; empty for nothing.

    Args:
        names: published or recorded.
        missing: names of the robot, with the prefix of its file, which may be cut short.
        document: content of the robot file.
    """
    short = [one.removeprefix(str(document.get("prefix", ""))) for one in missing]
    for name in names:
        prefix = name.removesuffix(short[0])
        if prefix != name and all(prefix + one in names for one in short):
            return f"prefix: {printable(prefix) or repr('')} in the robot file would fit"
    if {one.lower() for one in missing} <= {one.lower() for one in names}:
        return "upper and lower case differ"
    return ""


def with_prefix(document: Document) -> Document:
    """The document with the names of motors and joints as messages have them.

    Args:
        document: a robot file in SI, not yet validated.
    """
    document = {**document, "prefix": PREFIX.get()} if PREFIX.get() else document
    prefix = document.get("prefix")
    if not isinstance(prefix, str) or not prefix:
        return document

    def named(name: str) -> str:
        return prefixed(name, prefix)

    def at(path: str) -> str:
        return _path(path, prefix)

    changes: dict[str, tuple[tuple[str, ...], Callable[[str], str]]] = {
        "motors": (("name",), named),
        "joints": (("name", "coupled"), named),
        "frames": (("joint", "joints"), named),
        "cables": (("motor", "joint"), named),
        "uncertainty": (("parameters", "model_error"), at),
        "residual": (("output", "inputs"), lambda name: at(name) if "/" in name else named(name)),
    }
    return {
        key: renamed(value, *changes[key]) if key in changes else value
        for key, value in document.items()
    }


def renamed(value: Any, keys: Collection[str], change: Callable[[str], str]) -> Any:
    """A part of a document with other names under some keys.

    Args:
        value: any part; its structure need not be valid.
        keys: keys of a name, of a list of names, or of a mapping by name.
        change: gives the other name.
    """
    if isinstance(value, list):
        return [renamed(one, keys, change) for one in value]
    if not isinstance(value, dict):
        return value
    return {
        key: _changed(one, change) if key in keys else renamed(one, keys, change)
        for key, one in value.items()
    }


def _changed(value: Any, change: Callable[[str], str]) -> Any:
    if isinstance(value, dict):
        return {change(name): one for name, one in value.items()}
    if isinstance(value, list):
        return [_changed(one, change) for one in value]
    return change(value) if isinstance(value, str) else value


def without_prefix(text: str, prefix: str) -> str:
    """A text with paths and channels, of names as the robot file has them, without its prefix."""
    for kind in _KINDS:
        text = text.replace(kind + prefix, kind)
    return text


def _path(path: str, prefix: str) -> str:
    """The path of a number, or the channel of an effort, with the prefix before the name."""
    for kind in _KINDS:
        if path.startswith(kind):
            return kind + prefixed(path.removeprefix(kind), prefix)
    return path
