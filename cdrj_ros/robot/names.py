"""Names of motors and joints as messages have them: those of the file after its prefix."""

from __future__ import annotations

from typing import Any, Final

Document = dict[str, Any]

_KINDS: Final = ("motors.", "joints.", "effort/")
"""Beginnings of paths of numbers of motors and joints, and of channels of their efforts."""


def prefixed(name: str, prefix: str) -> str:
    """The name after the prefix; a name that begins with it stays."""
    return name if name.startswith(prefix) else prefix + name


def with_prefix(document: Document) -> Document:
    """The document with the names of motors and joints as messages have them.

    Args:
        document: satisfies the schema.
    """
    prefix: str = document.get("prefix", "")
    if not prefix:
        return document
    found = {**document}
    for kind in ("motors", "joints"):
        entries = document[kind]
        found[kind] = [{**one, "name": prefixed(one["name"], prefix)} for one in entries]
    for kind in ("frames", "cables"):
        found[kind] = _referring(document.get(kind, []), prefix)
    if "uncertainty" in document:
        entry: Document = document["uncertainty"]
        found["uncertainty"] = {
            **entry,
            "parameters": [_path(path, prefix) for path in entry.get("parameters", ())],
            "model_error": {
                _path(name, prefix): value for name, value in entry.get("model_error", {}).items()
            },
        }
    return found


def _referring(value: Any, prefix: str) -> Any:
    """A part of the document whose references to motors and joints have the prefix."""
    if isinstance(value, list):
        return [_referring(one, prefix) for one in value]
    if not isinstance(value, dict):
        return value
    return {
        key: prefixed(one, prefix)
        if key in ("motor", "joint") and isinstance(one, str)
        else _referring(one, prefix)
        for key, one in value.items()
    }


def _path(path: str, prefix: str) -> str:
    """The path of a number, or the channel of an effort, with the prefix before the name."""
    for kind in _KINDS:
        if path.startswith(kind):
            return kind + prefixed(path.removeprefix(kind), prefix)
    return path
